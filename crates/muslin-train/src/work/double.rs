//! The whole gradient of a pack in single precision, as the network learns from it, against the reference laws in
//! double.

use std::sync::LazyLock;

use glam::{DMat3, DVec3};
use muslin_energy::{contact::Barrier, membrane, plate};

use super::*;
use crate::Training;
use crate::testing::Class;

static CLASS: LazyLock<Class> = LazyLock::new(Class::new);
static OUTFIT: LazyLock<Class> = LazyLock::new(Class::outfit);

/// Where the cloth of a pack is now [m].
fn laid(trainer: &Trainer, pack: &Pack) -> Vec<Row> {
    let (_, mut x) = trainer.predict(pack, &mut MlpTape::default());
    trainer.carry(pack, &mut x);
    x
}

/// What the reference laws say of one pose, in the rest frame [N].
fn reference(
    trainer: &Trainer,
    (pack, walls): Walled<'_>,
    (x, lane): (&[DVec3], usize),
) -> Vec<DVec3> {
    let wearer = &trainer.wearers[pack.wearer];
    let (cut, cloth) = (&wearer.cut, wearer.lesson.cloth);
    let firmness = wearer.firmness(trainer.firm_at(trainer.now.step));
    let mut g = vec![DVec3::ZERO; x.len()];
    for (f, face) in cloth.faces.iter().enumerate() {
        let corners = face.map(|v| x[v as usize]);
        let (_, d) = membrane::gradient(&corners, &cut.rest[f], &wearer.stretch(f));
        (0..3).for_each(|k| g[face[k] as usize] += d[k] * firmness);
    }
    let bend = |f: usize| cloth.materials[cloth.material_of[f] as usize].bend;
    for (verts, rest) in plate::plates(&cloth.faces, &cloth.rest, bend) {
        let (_, d) = plate::gradient(&verts.map(|v| x[v as usize]), &rest);
        (0..6).for_each(|k| g[verts[k] as usize] += d[k]);
    }
    let wall = trainer.wall();
    let barrier = Barrier {
        radius: wall.radius.into(),
        width: wall.width.into(),
        stiffness: wall.stiffness.into(),
    };
    let push = |at: DVec3, plane: &[Row; 4]| {
        let [a, b, c, offset] = plane.map(|row| f64::from(row[lane]));
        let normal = DVec3::new(a, b, c);
        normal * barrier.at(normal.dot(at) - offset)[1]
    };
    for lying in &walls.others {
        let force = push(x[lying.vertex as usize], &lying.plane);
        g[lying.vertex as usize] += force;
        let corners = lying.corners[lane].into_iter().zip(lying.shares[lane]);
        corners.for_each(|(v, share)| g[v as usize] -= force * f64::from(share));
    }
    let folds = pack.folds.iter().map(|f| (f.0 as usize, &f.1));
    for (v, plane) in walls.skin.iter().enumerate().chain(folds) {
        g[v] += push(x[v], plane);
    }
    for (v, g) in g.iter_mut().enumerate() {
        *g += DVec3::Y * (f64::from(cut.mass[v]) * 9.81);
        let (mut turn, mut at) = (DMat3::ZERO, DVec3::ZERO);
        for (b, w) in trainer.skin.row(v) {
            let bone = pack.bones[b].map(|row| f64::from(row[lane]) * f64::from(w));
            let column = |c: usize| DVec3::from_slice(&bone[3 * c..]);
            turn += DMat3::from_cols(column(0), column(1), column(2));
            at += column(3);
        }
        if cut.pins.contains(&(v as u32)) {
            let rest = DVec3::from_array(wearer.template[v].map(f64::from));
            *g += (x[v] - (turn * rest + at)) * f64::from(PIN);
        }
        *g = turn.transpose() * *g;
    }
    g
}

#[test]
fn single_precision_leads_where_double_does() {
    for class in [&*CLASS, &*OUTFIT] {
        let mut trainer = class.trainer();
        for _ in 0..4 {
            trainer.step().expect("finite");
        }
        let mut pack = trainer.now.packs[0].clone();
        pack.visits = 0;
        let x = laid(&trainer, &pack);
        trainer.look(&mut pack, &x);
        let walls = Walls {
            skin: trainer.walls(&mut pack, &x),
            others: trainer.lying(&mut pack, &x),
        };
        let (mut g, mut work) = (vec![[0.0; LANES]; x.len()], Work::default());
        trainer.ask((&pack, &walls), (&x, &mut g), &mut work);
        assert!(work.energies.contact > 0.0 && work.broken.is_none());
        let [mut both, mut own, mut theirs] = [0.0; 3];
        for lane in 0..LANES {
            let want = reference(&trainer, (&pack, &walls), (&points(&x, lane), lane));
            for (a, b) in points(&g, lane).iter().zip(&want) {
                both += a.dot(*b);
                own += a.length_squared();
                theirs += b.length_squared();
            }
        }
        let cosine = both / (own * theirs).sqrt();
        assert!(cosine > 0.9999, "{cosine}");
        assert!((own / theirs - 1.0f64).abs() < 1e-3, "{own} {theirs}");
    }
}
