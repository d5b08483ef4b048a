//! The wardrobe's garments, on many bodies.

use glam::{DVec2, DVec3};
use muslin_body::{Avatar, Figure, Shape};
use muslin_garment::{
    Cut, Dress, Garment, GarmentError, Opening, Outfit, Recipe, Skirt, Tee, Trousers, Worn,
};
use muslin_geom::{Mesh, Surface, intersecting_pairs, self_intersections};
use std::f64::consts::TAU;
use std::sync::OnceLock;

fn avatar() -> &'static Avatar {
    static AVATAR: OnceLock<Avatar> = OnceLock::new();
    AVATAR.get_or_init(|| Avatar::embedded().expect("the embedded avatar is sound"))
}

fn tee() -> &'static Garment {
    static TEE: OnceLock<Garment> = OnceLock::new();
    TEE.get_or_init(|| made(Recipe::Tee(Tee::default())))
}

fn trousers() -> &'static Garment {
    static TROUSERS: OnceLock<Garment> = OnceLock::new();
    TROUSERS.get_or_init(|| made(Recipe::Trousers(Trousers::default())))
}

fn skirt() -> &'static Garment {
    static SKIRT: OnceLock<Garment> = OnceLock::new();
    SKIRT.get_or_init(|| made(Recipe::Skirt(Skirt::default())))
}

fn dress() -> &'static Garment {
    static DRESS: OnceLock<Garment> = OnceLock::new();
    DRESS.get_or_init(|| made(Recipe::Dress(Dress::default())))
}

fn made(recipe: Recipe) -> Garment {
    Garment::make(avatar(), &recipe).expect("the recipe is in range")
}

fn figure(traits: &[(&str, f64)]) -> Figure {
    let shape = traits.iter().fold(Shape::default(), |s, (name, value)| {
        s.with(name, *value).expect("a phenotype in range")
    });
    avatar().figure(&shape).expect("an adult")
}

/// Thin, heavy, muscular and tall, short, full-bosomed, and old bodies.
fn bodies() -> Vec<Figure> {
    [
        &[("gender", 1.0), ("weight", 0.05), ("muscle", 0.3)][..],
        &[
            ("gender", 1.0),
            ("weight", 1.0),
            ("cupsize", 1.0),
            ("height", 0.4),
        ],
        &[("gender", 0.0), ("muscle", 1.0), ("height", 0.9)],
        &[("height", 0.0), ("weight", 0.6)],
        &[("gender", 1.0), ("cupsize", 1.0), ("firmness", 1.0)],
        &[("gender", 0.0), ("age", 1.0), ("weight", 0.8)],
    ]
    .iter()
    .map(|t| figure(t))
    .collect()
}

fn mesh(garment: &Garment, worn: &Worn) -> Mesh {
    Mesh {
        verts: worn.verts.clone(),
        faces: garment.faces.clone(),
    }
}

fn skin(figure: &Figure) -> Mesh {
    Mesh {
        verts: figure.verts.clone(),
        faces: avatar().collision_faces().to_vec(),
    }
}

fn angles(x: &[DVec3], f: [u32; 3]) -> [f64; 3] {
    let p = f.map(|i| x[i as usize]);
    [0, 1, 2].map(|k| {
        (p[(k + 1) % 3] - p[k])
            .angle_between(p[(k + 2) % 3] - p[k])
            .to_degrees()
    })
}

#[test]
fn garments_open_where_people_go_in_and_out() {
    let openings = |g: &Garment| g.rims.iter().map(|r| r.opening).collect::<Vec<_>>();
    let (skirt, dress) = (openings(skirt()), openings(dress()));
    assert_eq!((skirt.len(), dress.len()), (2, 4), "{skirt:?} {dress:?}");
    assert!(skirt.contains(&Opening::Waist) && skirt.contains(&Opening::Hem));
    assert!(dress.contains(&Opening::Neck) && dress.contains(&Opening::Hem));
    let (tee, trousers) = (openings(tee()), openings(trousers()));
    assert_eq!((tee.len(), trousers.len()), (4, 3), "{tee:?} {trousers:?}");
    assert!(tee.contains(&Opening::Neck) && tee.contains(&Opening::Hem));
    assert!(trousers.contains(&Opening::Waist));
}

#[test]
fn trousers_are_pinned_around_the_waist_and_a_tee_hangs_free() {
    let waist = trousers()
        .rims
        .iter()
        .find(|r| r.opening == Opening::Waist)
        .expect("a waist");
    assert_eq!(trousers().pins.len(), waist.verts.len());
    assert!(trousers().pins.len() > 40);
    assert!(tee().pins.is_empty());
}

/// What a tape around the trunk reads at a height [m].
fn tape(figure: &Figure, y: f64) -> f64 {
    let mut around: Vec<DVec2> = Vec::new();
    for f in avatar().collision_faces() {
        for k in 0..3 {
            let [a, b] = [f[k], f[(k + 1) % 3]].map(|i| figure.verts[i as usize]);
            if (a.y < y) != (b.y < y) {
                let p = a.lerp(b, (y - a.y) / (b.y - a.y));
                // Hands are farther out.
                around.extend((p.x.abs() < 0.25).then_some(DVec2::new(p.x, p.z)));
            }
        }
    }
    let reach = |k: u32| {
        let way = DVec2::from_angle(f64::from(k) * TAU / 360.0);
        around.iter().map(|p| p.dot(way)).fold(f64::MIN, f64::max)
    };
    // Cauchy: the mean reach times 2 pi.
    (0..360).map(reach).sum::<f64>() * TAU / 360.0
}

#[test]
fn waistbands_are_as_wide_as_they_are_cut() {
    let bodies = [
        vec![],
        vec![("gender", 1.0)],
        vec![("gender", 0.0), ("weight", 0.3)],
    ];
    for traits in bodies {
        let figure = figure(&traits);
        for (garment, ease) in [(trousers(), 0.03), (skirt(), 0.02)] {
            let worn = garment.worn(avatar(), &figure, &[]);
            let worn = worn.expect("an embedded avatar");
            let waist = garment.rims.iter().find(|r| r.opening == Opening::Waist);
            let rim = &waist.expect("a waist").verts;
            let at = |k: usize| worn.verts[rim[k % rim.len()] as usize];
            let girth: f64 = (0..rim.len()).map(|k| at(k).distance(at(k + 1))).sum();
            let height = (0..rim.len()).map(|k| at(k).y).sum::<f64>() / rim.len() as f64;
            let more = girth - tape(&figure, height);
            // Cloth is some 4 mm off the skin at least, 26 mm of girth, and a rim goes up and down a little.
            let room = more - f64::max(ease, 0.026);
            let fits = (0.0..0.02).contains(&room);
            assert!(fits, "{} of {traits:?}: {room}", garment.name);
        }
    }
}

#[test]
fn a_vertex_hangs_wholly_on_the_body() {
    for garment in [tee(), trousers(), skirt(), dress()] {
        assert!(garment.binding.is_convex(avatar().n_verts()));
        let skin = garment.skin_weights(avatar());
        assert!(skin.is_convex(avatar().rig().n_bones()));
        assert_eq!(skin.n_rows(), garment.n_verts());
    }
}

#[test]
fn triangles_are_even_and_of_the_size_asked_for() {
    let figure = figure(&[]);
    for garment in [tee(), trousers(), skirt(), dress()] {
        let worn = garment
            .worn(avatar(), &figure, &[])
            .expect("an embedded avatar");
        let all = garment.faces.iter().map(|f| angles(&worn.verts, *f));
        let worst = all.flatten().fold(180.0, f64::min);
        assert!(worst > 18.0, "{}: {worst:.1} degrees", garment.name);
        let x = &worn.verts;
        let sides = garment
            .faces
            .iter()
            .flat_map(|f| [[f[0], f[1]], [f[1], f[2]], [f[2], f[0]]]);
        let lengths: Vec<f64> = sides
            .map(|[a, b]| (x[a as usize] - x[b as usize]).length())
            .collect();
        let mean = lengths.iter().sum::<f64>() / lengths.len() as f64;
        assert!(
            (0.9..1.12).contains(&(mean / garment.recipe.as_ref().expect("it was cut").edge())),
            "{mean}"
        );
    }
}

#[test]
fn an_outfit_starts_clean_on_every_body() {
    starts_clean(&[trousers(), tee()]);
}

#[test]
fn skirts_and_dresses_start_clean_on_every_body() {
    starts_clean(&[skirt(), tee()]);
    starts_clean(&[trousers(), dress()]);
}

fn starts_clean(garments: &[&Garment]) {
    let outfit = Outfit {
        garments: garments.iter().copied().cloned().collect(),
    };
    for (k, figure) in bodies().iter().enumerate() {
        let worn = outfit.worn(avatar(), figure).expect("an embedded avatar");
        let body = skin(figure);
        let surface = Surface::new(&body.verts, &body.faces);
        for (garment, worn) in outfit.garments.iter().zip(&worn) {
            let name = &garment.name;
            let cloth = mesh(garment, worn);
            let close = |p: &&DVec3| surface.closest(**p, 0.05).is_some_and(|c| c.signed < 0.001);
            assert_eq!(
                worn.verts.iter().filter(close).count(),
                0,
                "body {k}, {name}: too close"
            );
            assert_eq!(
                intersecting_pairs(&cloth, &body).len(),
                0,
                "body {k}, {name}: in body"
            );
            assert_eq!(
                self_intersections(&cloth).len(),
                0,
                "body {k}, {name}: in itself"
            );
        }
        let [low, high] = [0, 1].map(|i| mesh(&outfit.garments[i], &worn[i]));
        assert_eq!(
            intersecting_pairs(&low, &high).len(),
            0,
            "body {k}: layers cross"
        );
    }
}

#[test]
fn a_tucked_shirt_lies_inside_the_trousers() {
    let outfit = Outfit {
        garments: vec![tee().clone(), trousers().clone()],
    };
    let worn = outfit
        .worn(avatar(), &figure(&[]))
        .expect("an embedded avatar");
    let [shirt, legs] = [0, 1].map(|i| mesh(&outfit.garments[i], &worn[i]));
    assert_eq!(intersecting_pairs(&shirt, &legs).len(), 0);
    let hem = tee()
        .rims
        .iter()
        .find(|r| r.opening == Opening::Hem)
        .expect("a hem");
    let outer = Surface::new(&legs.verts, &legs.faces);
    let inside = |i: &&u32| {
        outer
            .closest(worn[0].verts[**i as usize], 0.2)
            .is_some_and(|c| c.signed < 0.0)
    };
    assert_eq!(hem.verts.iter().filter(inside).count(), hem.verts.len());
}

#[test]
fn only_a_neckband_starts_strained_and_the_pattern_is_true_to_size() {
    let figure = figure(&[]);
    for garment in [tee(), trousers(), skirt(), dress()] {
        let worn = garment
            .worn(avatar(), &figure, &[])
            .expect("an embedded avatar");
        let mut strained = 0;
        for (f, rest) in garment.faces.iter().zip(&worn.rest) {
            let p = f.map(|i| worn.verts[i as usize]);
            for k in 0..3 {
                let (want, got) = (
                    (p[(k + 1) % 3] - p[k]).length(),
                    (rest[(k + 1) % 3] - rest[k]).length(),
                );
                let pull = 1.0 - got / want;
                assert!((-1e-9..0.051).contains(&pull), "{got} for {want}");
                strained += usize::from(pull > 1e-9);
            }
            assert!(
                (rest[1] - rest[0]).perp_dot(rest[2] - rest[0]) > 0.0,
                "face down"
            );
        }
        let band = if garment.pins.is_empty() { 0.06 } else { 0.0 };
        let share = strained as f64 / (3 * garment.faces.len()) as f64;
        assert!(
            share <= band,
            "{}: {share:.3} of the edges pull",
            garment.name
        );
        let area = |t: &[glam::DVec2; 3]| (t[1] - t[0]).perp_dot(t[2] - t[0]) / 2.0;
        let (uv, rest) = (
            garment.uv.iter().map(area).sum::<f64>(),
            worn.rest.iter().map(area).sum::<f64>(),
        );
        assert!((uv / rest - 1.0).abs() < 0.02, "{uv} against {rest}");
    }
}

#[test]
fn no_body_leaves_cloth_without_a_shape() {
    // Its sleeves are so narrow for such triangles that some are lines on the pattern as well.
    let coarse = made(Recipe::Tee(Tee {
        edge: 0.025,
        sleeve: 1.9,
        ..Tee::default()
    }));
    for figure in bodies() {
        for garment in [tee(), trousers(), skirt(), dress(), &coarse] {
            let worn = garment
                .worn(avatar(), &figure, &[])
                .expect("an embedded avatar");
            for (f, t) in worn.rest.iter().enumerate() {
                let side = |k: usize| t[k].distance_squared(t[(k + 1) % 3]);
                let longest = side(0).max(side(1)).max(side(2));
                let quality = (t[1] - t[0]).perp_dot(t[2] - t[0]) / longest;
                assert!(quality > 0.2, "{} face {f}: {quality}", garment.name);
            }
        }
    }
}

#[test]
fn the_grain_runs_down_the_body() {
    let worn = tee()
        .worn(avatar(), &figure(&[]), &[])
        .expect("an embedded avatar");
    let front = tee()
        .panel
        .iter()
        .zip(&tee().faces)
        .zip(&worn.rest)
        .filter(|((p, _), _)| **p == 0);
    let (mut upright, mut all) = (0, 0);
    for ((_, f), rest) in front {
        let p = f.map(|i| worn.verts[i as usize]);
        for k in 0..3 {
            let (d, r) = (p[(k + 1) % 3] - p[k], rest[(k + 1) % 3] - rest[k]);
            all += 1;
            upright += usize::from((d.y - r.y).abs() < 0.35 * d.length());
        }
    }
    assert!(
        upright * 100 > all * 90,
        "{upright} of {all} edges keep their height"
    );
}

#[test]
fn a_hem_is_level_and_a_neckline_is_smooth() {
    let worn = tee()
        .worn(avatar(), &figure(&[]), &[])
        .expect("an embedded avatar");
    let rim = |o: Opening| {
        tee()
            .rims
            .iter()
            .find(|r| r.opening == o)
            .expect("it has one")
    };
    let x = |i: u32| worn.verts[i as usize];
    let hem = &rim(Opening::Hem).verts;
    assert!(hem.iter().all(|&i| (x(i).y - x(hem[0]).y).abs() < 1e-6));
    let neck = &rim(Opening::Neck).verts;
    for k in 0..neck.len() {
        let at = |d: usize| x(neck[(k + d) % neck.len()]);
        let turn = (at(1) - at(0)).angle_between(at(2) - at(1)).to_degrees();
        assert!(turn < 35.0, "the neckline turns by {turn:.0} degrees");
    }
}

/// Half the width of a shirt at a height [m].
fn half_width(worn: &Worn, y: f64) -> f64 {
    let near = worn.verts.iter().filter(|p| (p.y - y).abs() < 0.012);
    near.map(|p| p.x.abs()).fold(0.0, f64::max)
}

#[test]
fn a_tee_hangs_straight_past_a_narrow_waist() {
    let figure = figure(&[("gender", 1.0), ("weight", 0.3)]);
    let worn = tee()
        .worn(avatar(), &figure, &[])
        .expect("an embedded avatar");
    let bottom = worn.verts.iter().map(|p| p.y).fold(f64::MAX, f64::min);
    let (hem, waist) = (half_width(&worn, bottom), half_width(&worn, bottom + 0.18));
    assert!((waist / hem - 1.0).abs() < 0.08, "waist {waist}, hem {hem}");
}

#[test]
fn a_skirt_falls_wider_the_more_it_flares_and_ends_at_the_knee() {
    let figure = figure(&[]);
    let [narrow, wide] = [Cut::Slim, Cut::Loose].map(|cut| {
        let garment = made(Recipe::Skirt(Skirt {
            edge: 0.025,
            ..Skirt::new(cut)
        }));
        let worn = garment.worn(avatar(), &figure, &[]);
        let worn = worn.expect("an embedded avatar");
        let bottom = worn.verts.iter().map(|p| p.y).fold(f64::MAX, f64::min);
        (half_width(&worn, bottom), bottom)
    });
    // The flares differ by 1.02 m and the hips by 0.05 m of girth: radii by 17 cm.
    assert!(
        (wide.0 - narrow.0 - 0.17).abs() < 0.02,
        "{narrow:?} {wide:?}"
    );
    let knee = figure.joints[avatar().bone("lowerleg01.L").expect("a knee")].y;
    assert!((narrow.1 - knee).abs() < 0.08, "{narrow:?}, knee {knee}");
}

#[test]
fn a_dress_is_one_piece_from_neck_to_knee() {
    let worn = dress().worn(avatar(), &figure(&[]), &[]);
    let worn = worn.expect("an embedded avatar");
    let height = |o: Opening| {
        let rim = dress().rims.iter().find(|r| r.opening == o);
        let rim = &rim.expect("it has one").verts;
        rim.iter().map(|&i| worn.verts[i as usize].y).sum::<f64>() / rim.len() as f64
    };
    let length = height(Opening::Neck) - height(Opening::Hem);
    assert!((0.8..1.1).contains(&length), "{length}");
}

/// A wrist is seven edges of 25 mm around.
#[test]
fn long_sleeves_keep_their_shape_however_large_the_triangles() {
    let area = |edge: f64| {
        let garment = made(Recipe::Tee(Tee {
            sleeve: 1.9,
            edge,
            ..Tee::default()
        }));
        let worn = garment.worn(avatar(), &figure(&[]), &[]);
        let worn = worn.expect("an embedded avatar");
        let mesh = Mesh {
            verts: worn.verts,
            faces: garment.faces,
        };
        let crossing = self_intersections(&mesh).len();
        assert!(crossing < 10, "edge {edge}: {crossing}");
        let corners = |f: &[u32; 3]| f.map(|i| mesh.verts[i as usize]);
        let twice = |[a, b, c]: [DVec3; 3]| (b - a).cross(c - a).length();
        mesh.faces
            .iter()
            .map(|f| twice(corners(f)) / 2.0)
            .sum::<f64>()
    };
    let fine = area(0.014);
    for edge in [0.022, 0.025] {
        let share = area(edge) / fine;
        assert!((0.93..1.07).contains(&share), "edge {edge}: {share}");
    }
}

#[test]
fn looser_cuts_take_more_cloth() {
    let area = |cut: Cut| {
        let garment = made(Recipe::Tee(Tee {
            edge: 0.025,
            ..Tee::new(cut)
        }));
        let worn = garment
            .worn(avatar(), &figure(&[]), &[])
            .expect("an embedded avatar");
        worn.rest
            .iter()
            .map(|t| (t[1] - t[0]).perp_dot(t[2] - t[0]) / 2.0)
            .sum::<f64>()
    };
    let (slim, regular, loose) = (area(Cut::Slim), area(Cut::Regular), area(Cut::Loose));
    assert!(
        slim < regular && regular < loose,
        "{slim} {regular} {loose}"
    );
}

#[test]
fn figures_that_cannot_be_cut_are_refused() {
    let recipe = Recipe::Tee(Tee {
        edge: 0.001,
        ..Tee::default()
    });
    let refused = Garment::make(avatar(), &recipe);
    assert!(matches!(
        refused,
        Err(GarmentError::OutOfRange {
            what: "edge length [m]",
            ..
        })
    ));
    let recipe = Recipe::Trousers(Trousers {
        leg: f64::NAN,
        ..Trousers::default()
    });
    assert!(matches!(
        Garment::make(avatar(), &recipe),
        Err(GarmentError::OutOfRange { .. })
    ));
}

#[test]
fn a_garment_comes_out_of_its_bytes_as_it_was_cut() {
    let recipe = Recipe::Dress(Dress {
        top: Tee {
            edge: 0.025,
            ..Tee::default()
        },
        ..Dress::default()
    });
    let cut = made(recipe.clone());
    let bytes = cut.encode(avatar()).expect("the avatar is sound");
    let bytes = bytes.expect("it was cut");
    let read = Garment::decode(avatar(), &recipe, &bytes).expect("whole");
    assert_eq!(read.expect("of this recipe"), cut);
    let other = Garment::decode(avatar(), &Recipe::Tee(Tee::default()), &bytes);
    assert!(other.expect("whole").is_none());
    for at in [0, 9, 13, 21, bytes.len() / 2] {
        let mut bad = bytes.clone();
        bad[at] ^= 16;
        let read = Garment::decode(avatar(), &recipe, &bad);
        assert!(matches!(read, Err(GarmentError::Damaged(_))), "byte {at}");
    }
}

#[test]
fn on_the_default_body_a_garment_lies_where_it_is_known_to_lie() {
    let known = avatar().standard().expect("the embedded avatar");
    let mut almost = known.clone();
    almost.verts[0].x += 1e-12;
    for garment in [tee(), trousers()] {
        let [a, b] = [&known, &almost].map(|f| {
            let worn = garment.worn(avatar(), f, &[]);
            worn.expect("an embedded avatar").verts
        });
        let far = a.iter().zip(&b).map(|(a, b)| a.distance(*b));
        let far = far.fold(0.0, f64::max);
        assert!(far > 0.0 && far < 1e-6, "{}: {far}", garment.name);
    }
}

#[test]
fn any_number_of_threads_gives_the_same_garment() {
    let recipe = Recipe::Tee(Tee {
        edge: 0.025,
        ..Tee::default()
    });
    let build = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.expect("threads can be started").install(|| {
            let garment = Garment::make(avatar(), &recipe).expect("in range");
            let worn = garment.worn(avatar(), &figure(&[("weight", 0.8)]), &[]);
            (garment, worn.expect("an embedded avatar"))
        })
    };
    assert_eq!(build(1), build(2));
}

/// Somebody so heavy that thighs meet and the trunk fills the armpits.
fn stout(gender: f64, height: f64, mass: f64) -> Figure {
    let shape = Shape::default()
        .with("gender", gender)
        .expect("a phenotype");
    let shape = shape
        .with_height_and_mass(avatar(), height, mass)
        .expect("in reach");
    avatar().figure(&shape).expect("an adult")
}

#[test]
fn stout_people_are_dressed_in_cloth_that_does_not_cross_itself() {
    let people = [
        (0.0, 1.69, 100.0),
        (0.5, 1.95, 140.0),
        (1.0, 1.69, 110.0),
        (1.0, 1.5, 79.0),
    ];
    for (gender, height, mass) in people {
        let figure = stout(gender, height, mass);
        let skin = skin(&figure);
        for garment in [tee(), trousers(), dress()] {
            let worn = garment.worn(avatar(), &figure, &[]).expect("a garment");
            let cloth = mesh(garment, &worn);
            let found = [
                self_intersections(&cloth).len(),
                intersecting_pairs(&cloth, &skin).len(),
            ];
            assert_eq!(found, [0, 0], "{} at {mass} kg", garment.name);
        }
    }
}
