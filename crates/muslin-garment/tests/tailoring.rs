//! Meshes of unknown size, axes and place, fitted to the default body.

use glam::{DMat3, DVec3};
use muslin_body::{Avatar, Figure, Shape};
use muslin_garment::{Garment, GarmentError, Opening, Recipe, Tailored, Tee};
use muslin_geom::{Mesh, Surface, intersecting_pairs, self_intersections};

fn avatar() -> Avatar {
    Avatar::embedded().expect("the embedded avatar is sound")
}

fn figure(avatar: &Avatar) -> Figure {
    avatar.figure(&Shape::default()).expect("the default shape")
}

fn tailored(mesh: &Mesh) -> Result<Tailored, GarmentError> {
    Garment::tailor(&avatar(), mesh, ("thing", 0.02))
}

/// An open tube with a waist of 75 cm and a hem of 140 cm, 50 cm tall, in centimetres.
fn skirt() -> Mesh {
    let (n, rows) = (60u32, 26u32);
    let mut mesh = Mesh::default();
    for r in 0..rows {
        let share = f64::from(r) / f64::from(rows - 1);
        for k in 0..n {
            let t = f64::from(k) / f64::from(n) * std::f64::consts::TAU;
            let wide = 22.0 - 9.5 * share;
            let at = DVec3::new(1.1 * wide * t.sin(), 50.0 * share, 0.85 * wide * t.cos());
            mesh.verts.push(at + DVec3::new(40.0, -7.0, 3.0));
        }
    }
    for r in 0..rows - 1 {
        for k in 0..n {
            let at = |r: u32, k: u32| r * n + k % n;
            let (a, b, c, d) = (at(r, k), at(r, k + 1), at(r + 1, k + 1), at(r + 1, k));
            mesh.faces.extend([[a, b, c], [a, c, d]]);
        }
    }
    mesh
}

#[test]
fn a_skirt_in_centimetres_finds_its_waist_and_is_held_there() {
    let made = tailored(&skirt()).expect("a skirt");
    assert!(
        made.warnings[0].contains("centimetres"),
        "{:?}",
        made.warnings
    );
    let [g] = &made.garments[..] else {
        panic!("one garment")
    };
    let waist = g.rims.iter().find(|r| r.opening == Opening::Waist);
    assert_eq!(g.pins.len(), waist.expect("a waist").verts.len());
    let avatar = avatar();
    let figure = figure(&avatar);
    let worn = g.worn(&avatar, &figure, &[]).expect("worn");
    let cloth = Mesh {
        verts: worn.verts,
        faces: g.faces.clone(),
    };
    let skin = Mesh {
        verts: figure.verts,
        faces: avatar.collision_faces().to_vec(),
    };
    assert_eq!(intersecting_pairs(&cloth, &skin).len(), 0);
    assert_eq!(self_intersections(&cloth).len(), 0);
    // Triangles of about the asked size stay those of the file.
    assert_eq!(cloth.verts.len(), skirt().verts.len());
}

#[test]
fn a_skirt_graded_to_a_stouter_body_is_cut_wider_and_has_no_more_strain_there() {
    let avatar = avatar();
    let made = tailored(&skirt()).expect("a skirt").garments.swap_remove(0);
    let shape = Shape::default().with_mass(&avatar, 95.0).expect("in reach");
    let stout = avatar.figure(&shape).expect("a figure");
    // Root mean square of how much longer the sides are than cut.
    let strain = |g: &Garment, figure: &Figure| {
        let worn = g.worn(&avatar, figure, &[]).expect("worn");
        let faces = g.faces.iter().zip(&worn.rest);
        let sides = faces.flat_map(|(f, r)| (0..3).map(move |k| (f[k], f[(k + 1) % 3], r, k)));
        let mut sum = (0.0, 0.0);
        for (i, j, r, k) in sides {
            let cut = r[k].distance(r[(k + 1) % 3]);
            let long = worn.verts[i as usize].distance(worn.verts[j as usize]);
            sum = (sum.0 + (long / cut - 1.0).max(0.0).powi(2), sum.1 + 1.0);
        }
        let area = worn
            .rest
            .iter()
            .map(|r| (r[1] - r[0]).perp_dot(r[2] - r[0]) / 2.0);
        ((sum.0 / sum.1).sqrt(), area.sum::<f64>())
    };
    let (tight, own) = strain(&made, &stout);
    let graded = made
        .clone()
        .graded(&avatar, (&stout, &stout))
        .expect("it is bound");
    let (fits, more) = strain(&graded, &stout);
    assert!(tight > 0.05 && fits < 0.3 * tight, "{tight} {fits}");
    assert!((1.1..1.8).contains(&(more / own)), "{own} {more} m2");
    // Held by somebody slim, it is taken in at the waist and as wide as it was below.
    let base = figure(&avatar);
    let held = made.clone().graded(&avatar, (&stout, &base));
    let held = held.expect("it is bound");
    let around = |g: &Garment, opening: Opening| {
        let worn = g.worn(&avatar, &stout, &[]).expect("worn");
        let rim = g.rims.iter().find(|r| r.opening == opening);
        let rim = &rim.expect("a rim").verts;
        let sides = g.faces.iter().zip(&worn.rest).flat_map(|(f, r)| {
            (0..3).map(move |k| ([f[k], f[(k + 1) % 3]], r[k].distance(r[(k + 1) % 3])))
        });
        let on_rim = sides.filter(|(s, _)| {
            s.iter().all(|v| rim.contains(v))
                && g.faces
                    .iter()
                    .filter(|f| s.iter().all(|v| f.contains(v)))
                    .count()
                    == 1
        });
        on_rim.map(|s| s.1).sum::<f64>()
    };
    let [slim, wide, taken_in] = [&made, &graded, &held].map(|g| around(g, Opening::Waist));
    assert!(wide > 1.1 * slim, "{slim} {wide}");
    assert!((taken_in / slim - 1.0).abs() < 0.01, "{slim} {taken_in}");
    let [wide, below] = [&graded, &held].map(|g| around(g, Opening::Hem));
    assert!((below / wide - 1.0).abs() < 1e-9, "{wide} {below}");
    // Not from where it was graded to before, and back on the default body it is what it was.
    let again = graded
        .clone()
        .graded(&avatar, (&stout, &stout))
        .expect("it is bound");
    assert!(again == graded);
    let back = again
        .graded(&avatar, (&figure(&avatar), &figure(&avatar)))
        .expect("it is bound");
    let (before, after) = (
        made.worn(&avatar, &stout, &[]),
        back.worn(&avatar, &stout, &[]),
    );
    let rests = before
        .expect("worn")
        .rest
        .into_iter()
        .zip(after.expect("worn").rest);
    let off = rests.flat_map(|(a, b)| (0..3).map(move |k| a[k].distance(b[k])));
    assert!(off.fold(0.0, f64::max) < 1e-9);
    // What was cut by a recipe fits whoever wears it.
    let tee = Garment::make(
        &avatar,
        &Recipe::Tee(Tee {
            edge: 0.025,
            ..Tee::default()
        }),
    );
    let tee = tee.expect("in range");
    assert!(
        tee.clone()
            .graded(&avatar, (&stout, &stout))
            .expect("it is bound")
            == tee
    );
}

#[test]
fn a_shirt_in_millimetres_lying_on_its_back_is_stood_up_where_it_came_from() {
    let avatar = avatar();
    let figure = figure(&avatar);
    let tee = Tee {
        edge: 0.02,
        ..Tee::default()
    };
    let tee = Garment::make(&avatar, &Recipe::Tee(tee)).expect("in range");
    let worn = tee.worn(&avatar, &figure, &[]).expect("worn");
    let turn = DMat3::from_rotation_x(std::f64::consts::FRAC_PI_2);
    let mesh = Mesh {
        verts: worn.verts.iter().map(|v| turn * *v * 1e3).collect(),
        // Inside out, as some programs write.
        faces: tee.faces.iter().map(|f| [f[0], f[2], f[1]]).collect(),
    };
    let made = tailored(&mesh).expect("a shirt");
    assert!(
        made.warnings[0].contains("millimetres") && made.warnings[0].contains("Z up"),
        "{:?}",
        made.warnings
    );
    let g = &made.garments[0];
    let again = g.worn(&avatar, &figure, &[]).expect("worn");
    let before = Surface::new(&worn.verts, &tee.faces);
    let off = |v: &DVec3| before.closest(*v, 0.2).map_or(0.2, |h| h.signed.abs());
    let mean = again.verts.iter().map(off).sum::<f64>() / again.verts.len() as f64;
    assert!(mean < 0.012, "{mean}");
    let outward = |(a, b): (&[u32; 3], &[u32; 3])| a == b;
    assert!(
        g.faces
            .iter()
            .zip(&tee.faces)
            .filter(|p| outward(*p))
            .count()
            > 0
    );
}

#[test]
fn what_is_turned_in_at_hem_and_waistband_is_left_out_and_it_is_said() {
    let plain = skirt();
    let (n, rows) = (60u32, 26u32);
    let mut mesh = plain.clone();
    let axis = DVec3::new(40.0, 0.0, 3.0);
    // At the hem three rows go on up inside of it, at the waist two down.
    let inside = |ring: u32, wide: f64, up: f64| {
        let own = plain.verts[(ring * n) as usize..][..n as usize].to_vec();
        own.into_iter().map(move |v| {
            let out = (v - axis).with_y(0.0);
            DVec3::new(0.0, v.y + up, 0.0) + axis + out * wide
        })
    };
    let rings = [(0, 0.97, 1.0), (0, 0.96, 2.0), (0, 0.95, 3.0)];
    let band = [(rows - 1, 0.98, -1.0), (rows - 1, 0.97, -2.0)];
    for (edge, rings) in [(0, &rings[..]), (rows - 1, &band[..])] {
        let mut last: Vec<u32> = (edge * n..(edge + 1) * n).collect();
        for &(ring, wide, up) in rings {
            let first = mesh.verts.len() as u32;
            mesh.verts.extend(inside(ring, wide, up));
            let next: Vec<u32> = (first..first + n).collect();
            for k in 0..n as usize {
                let j = (k + 1) % n as usize;
                let (a, b, c, d) = (last[k], last[j], next[j], next[k]);
                mesh.faces.extend([[a, b, c], [a, c, d]]);
            }
            last = next;
        }
    }
    let made = tailored(&mesh).expect("a skirt");
    let told = made.warnings.iter().any(|w| w.contains("600 triangles"));
    assert!(told, "{:?}", made.warnings);
    assert_eq!(made.garments[0].faces.len(), plain.faces.len());
    let plain = tailored(&plain).expect("a skirt");
    assert_eq!(plain.warnings.len(), 1, "{:?}", plain.warnings);
}

/// A tee around the default body [m], with sleeves so long (1 to the elbow, 2 to the wrist).
fn tee(sleeve: f64) -> Mesh {
    let avatar = avatar();
    let recipe = Recipe::Tee(Tee {
        edge: 0.02,
        sleeve,
        ..Tee::default()
    });
    let tee = Garment::make(&avatar, &recipe).expect("in range");
    let worn = tee.worn(&avatar, &figure(&avatar), &[]).expect("worn");
    Mesh {
        verts: worn.verts,
        faces: tee.faces,
    }
}

/// How far each vertex of the first garment made is from a mesh, on average [m].
fn mean_distance(made: &Tailored, from: &Mesh) -> f64 {
    let avatar = avatar();
    let g = &made.garments[0];
    let worn = g.worn(&avatar, &figure(&avatar), &[]).expect("worn");
    let there = Surface::new(&from.verts, &from.faces);
    let off = |v: &DVec3| there.closest(*v, 0.2).map_or(0.2, |h| h.signed.abs());
    worn.verts.iter().map(off).sum::<f64>() / worn.verts.len() as f64
}

#[test]
fn a_shirt_that_is_open_in_front_finds_its_neck() {
    let mut open = tee(1.0);
    let verts = open.verts.clone();
    open.faces.retain(|f| {
        let middle = f.iter().map(|v| verts[*v as usize]).sum::<DVec3>() / 3.0;
        middle.x.abs() > 0.015 || middle.z < 0.05
    });
    let away = |v: &DVec3| (*v - DVec3::new(0.0, 0.12, 0.03)) * 10.0;
    let mesh = Mesh {
        verts: open.verts.iter().map(away).collect(),
        faces: open.faces.clone(),
    };
    let made = tailored(&mesh).expect("a shirt");
    assert!(
        made.warnings[0].contains("decimetres"),
        "{:?}",
        made.warnings
    );
    let mean = mean_distance(&made, &open);
    assert!(mean < 0.012, "{mean}");
}

#[test]
fn what_is_no_garment_is_refused_in_words() {
    let closed = {
        let mut mesh = skirt();
        let (n, last) = (60u32, 25 * 60u32);
        for ring in [0, last] {
            for k in 1..n - 1 {
                let f = [ring, ring + k, ring + k + 1];
                mesh.faces
                    .push(if ring == 0 { [f[0], f[2], f[1]] } else { f });
            }
        }
        mesh
    };
    let err = tailored(&closed).expect_err("a closed shell").to_string();
    assert!(
        err.contains("closed") && err.contains("cut openings"),
        "{err}"
    );
    let loose = Mesh {
        verts: (0..300)
            .map(|i| DVec3::new(f64::from(i), f64::from(i % 7), 0.0))
            .collect(),
        faces: (0..100).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect(),
    };
    let err = tailored(&loose).expect_err("loose triangles").to_string();
    assert!(
        err.contains("no piece has more than a few triangles"),
        "{err}"
    );
}

/// The skin that hangs on bones of these names, by more than half, `off` metres outside of itself.
fn second_skin(avatar: &Avatar, figure: &Figure, names: &[&str], off: f64) -> Mesh {
    let rig = avatar.rig();
    let on = |b: u32| {
        names
            .iter()
            .any(|n| rig.bones[b as usize].name.starts_with(n))
    };
    let share = |row: &[(u32, f64)]| row.iter().filter(|e| on(e.0)).map(|e| e.1).sum::<f64>();
    let own: Vec<bool> = rig.weights.rows().map(|r| share(r) > 0.5).collect();
    let all = avatar.collision_faces();
    let skin = Mesh {
        verts: figure.verts[..avatar.part(muslin_body::Part::Body).end].to_vec(),
        faces: all.to_vec(),
    };
    let normals = skin.vertex_normals();
    let mut number = vec![None; skin.verts.len()];
    let mut out = Mesh::default();
    for f in all.iter().filter(|f| f.iter().all(|v| own[*v as usize])) {
        out.faces.push(f.map(|v| {
            let v = v as usize;
            *number[v].get_or_insert_with(|| {
                out.verts.push(skin.verts[v] + normals[v] * off);
                out.verts.len() as u32 - 1
            })
        }));
    }
    out
}

/// The same in other units, turned and moved.
fn placed(mesh: &Mesh, turn: DMat3, (per_metre, shift): (f64, DVec3)) -> Mesh {
    Mesh {
        verts: (mesh.verts.iter())
            .map(|v| turn * *v * per_metre + shift)
            .collect(),
        faces: mesh.faces.clone(),
    }
}

#[test]
fn gloves_and_boots_find_hands_and_feet_and_are_held_where_they_begin() {
    let avatar = avatar();
    let figure = figure(&avatar);
    let gloves = second_skin(&avatar, &figure, &["wrist", "metacarpal", "finger"], 0.003);
    let boots = second_skin(&avatar, &figure, &["lowerleg02", "foot", "toe"], 0.006);
    // Boots stand on the floor in inches, gloves come lying on their backs in centimetres, from the origin.
    let floor = figure.verts.iter().map(|v| v.y).fold(f64::MAX, f64::min);
    let boots = placed(
        &boots,
        DMat3::IDENTITY,
        (1.0 / 0.0254, -DVec3::Y * floor / 0.0254),
    );
    let middle = gloves.verts.iter().sum::<DVec3>() / gloves.verts.len() as f64;
    let lying = DMat3::from_rotation_x(std::f64::consts::FRAC_PI_2);
    let gloves = placed(&gloves, lying, (100.0, lying * middle * -100.0));
    for (mesh, unit, on, low) in [
        (&boots, "inches from the floor, Y up", "foot", true),
        (
            &gloves,
            "centimetres and moved to where it fits, Z up",
            "hand",
            false,
        ),
    ] {
        let made = tailored(mesh).expect("they are garments");
        let told = made.warnings.join("\n");
        assert!(
            told.contains(unit) && told.contains(&format!("left {on}")),
            "{told}"
        );
        assert_eq!(made.garments.len(), 2);
        for g in &made.garments {
            assert_eq!(g.rims.len(), 1);
            assert_eq!(g.pins.len(), g.rims[0].verts.len());
            let worn = g.worn(&avatar, &figure, &[]).expect("worn");
            let middle = worn.verts.iter().sum::<DVec3>() / worn.verts.len() as f64;
            assert_eq!(middle.y < floor + 0.3, low, "{middle}");
        }
    }
}
