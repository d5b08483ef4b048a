//! Pictures of simple scenes show what they must.

use glam::{DAffine3, DMat3, DVec2, DVec3};
use muslin_geom::Image;
use muslin_picture::{
    Background, Camera, Ground, Layer, Material, Options, Part, Scene, View, Weave, WeaveKind,
    overlay, render, turntable,
};

/// A camera at `z` metres that looks at the origin along -Z.
fn frontal(size: usize, z: f64) -> Camera {
    Camera {
        width: size,
        height: size,
        focal: size as f64,
        centre: DVec2::splat(size as f64 * 0.5),
        world_from_camera: DAffine3::from_mat3_translation(DMat3::IDENTITY, DVec3::Z * z),
    }
}

fn quick() -> Options {
    Options {
        supersampling: 4,
        shadow_map: 256,
        dome: 24,
        ..Options::default()
    }
}

fn painted(colour: [f32; 3]) -> Material {
    Material {
        colour,
        two_sided: true,
        specular: 0.0,
        ..Material::mannequin()
    }
}

/// A square of side `s` at height `z`, facing +Z.
fn square(s: f64, z: f64, material: Material) -> Part {
    let at = |x: f64, y: f64| DVec3::new(x * s, y * s, z);
    let verts = vec![at(-0.5, -0.5), at(0.5, -0.5), at(0.5, 0.5), at(-0.5, 0.5)];
    Part::new(verts, vec![[0, 1, 2], [0, 2, 3]], material)
}

/// A closed box from `lo` to `hi`.
fn solid(lo: DVec3, hi: DVec3) -> Part {
    let corner = |i: usize| {
        let pick = |b: usize, lo: f64, hi: f64| if i >> b & 1 == 0 { lo } else { hi };
        DVec3::new(
            pick(0, lo.x, hi.x),
            pick(1, lo.y, hi.y),
            pick(2, lo.z, hi.z),
        )
    };
    let quads = [
        [0, 2, 3, 1],
        [4, 5, 7, 6],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 4, 6, 2],
        [1, 3, 7, 5],
    ];
    let (mut verts, mut faces) = (Vec::new(), Vec::new());
    for quad in quads {
        let first = verts.len() as u32;
        verts.extend(quad.map(corner));
        faces.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
    }
    Part::new(verts, faces, painted([0.5; 3]))
}

fn clear(parts: Vec<Part>) -> Scene {
    Scene {
        parts,
        ground: None,
        background: Background::Transparent,
    }
}

fn pixel(image: &Image, x: usize, y: usize) -> [u8; 4] {
    image.pixels[y * image.width + x]
}

#[test]
fn coverage_is_the_projected_area() {
    // 0.31 m at 2 m through a focal length of 200 px is 31 px a side.
    let scene = clear(vec![square(0.31, 0.0, painted([0.5; 3]))]);
    let image = render(&scene, &frontal(200, 2.0), &quick());
    let covered: f64 = image.pixels.iter().map(|p| f64::from(p[3]) / 255.0).sum();
    assert!((covered - 961.0).abs() < 2.0, "{covered}");
    assert_eq!(pixel(&image, 100, 100)[3], 255);
    assert_eq!(pixel(&image, 10, 10), [0; 4]);
}

#[test]
fn the_nearer_surface_is_seen_whatever_the_order() {
    let red = square(0.5, 0.0, painted([0.6, 0.02, 0.02]));
    let green = square(0.3, 0.4, painted([0.02, 0.6, 0.02]));
    for parts in [vec![red.clone(), green.clone()], vec![green, red]] {
        let image = render(&clear(parts), &frontal(100, 2.0), &quick());
        let [middle, rim] = [pixel(&image, 50, 50), pixel(&image, 39, 50)];
        assert!(
            middle[1] > 2 * middle[0] && rim[0] > 2 * rim[1],
            "{middle:?} {rim:?}"
        );
    }
}

#[test]
fn one_sided_surfaces_vanish_from_behind() {
    let one = Material {
        two_sided: false,
        ..painted([0.5; 3])
    };
    let mut part = square(0.5, 0.0, one);
    let front = render(&clear(vec![part.clone()]), &frontal(64, 2.0), &quick());
    part.faces.iter_mut().for_each(|f| f.swap(0, 1));
    let back = render(&clear(vec![part]), &frontal(64, 2.0), &quick());
    assert_eq!(pixel(&front, 32, 32)[3], 255);
    assert!(back.pixels.iter().all(|p| *p == [0; 4]));
}

#[test]
fn any_number_of_threads_gives_the_same_bytes() {
    let mut scene = clear(vec![
        solid(DVec3::splat(-0.2), DVec3::splat(0.3)),
        square(1.0, -0.4, painted([0.3; 3])),
    ]);
    scene.ground = Some(Ground::at(-0.5));
    scene.background = Background::default();
    let camera = Camera::framing(
        &scene.points(),
        &View {
            width: 160,
            height: 120,
            yaw: 0.4,
            ..View::default()
        },
    );
    let shots = [1, 2, 5].map(|n| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(n)
            .build()
            .unwrap();
        pool.install(|| render(&scene, &camera, &quick()))
    });
    assert!(shots[0] == shots[1] && shots[0] == shots[2]);
}

#[test]
fn nothing_to_show_is_the_backdrop() {
    let plain = Scene {
        background: Background::Plain([1.0; 3]),
        ground: Some(Ground::at(0.0)),
        parts: vec![],
    };
    let image = render(&plain, &frontal(40, 2.0), &quick());
    assert!(image.pixels.iter().all(|p| *p == [255; 4]));
    assert_eq!(render(&plain, &frontal(0, 2.0), &quick()).pixels.len(), 0);
    assert_eq!(
        turntable(
            &plain,
            &View {
                width: 8,
                height: 8,
                ..View::default()
            },
            2,
            &quick()
        )
        .len(),
        2
    );
}

#[test]
fn broken_faces_are_left_out_and_the_rest_is_shown() {
    let mut part = square(0.5, 0.0, painted([0.5; 3]));
    let whole = render(&clear(vec![part.clone()]), &frontal(64, 2.0), &quick());
    part.verts.extend([DVec3::NAN, DVec3::splat(f64::INFINITY)]);
    part.faces
        .extend([[0, 1, 99], [0, 1, 4], [0, 5, 2], [1, 1, 1], [0, 1, 1]]);
    let scene = clear(vec![part]);
    assert_eq!(scene.points().len(), 4);
    assert_eq!(render(&scene, &frontal(64, 2.0), &quick()), whole);
}

#[test]
fn a_wall_through_the_lens_fills_its_half_of_the_picture() {
    // A floor that runs from far before the camera to far behind it.
    let at = |x: f64, z: f64| DVec3::new(x, -1.0, z);
    let verts = vec![
        at(-500.0, 500.0),
        at(500.0, 500.0),
        at(500.0, -500.0),
        at(-500.0, -500.0),
    ];
    let part = Part::new(verts, vec![[0, 1, 2], [0, 2, 3]], painted([0.5; 3]));
    let image = render(&clear(vec![part]), &frontal(64, 0.0), &quick());
    for y in 0..64 {
        let alpha = pixel(&image, 32, y)[3];
        assert!(
            y == 32 || alpha == if y < 32 { 0 } else { 255 },
            "row {y}: {alpha}"
        );
    }
}

#[test]
fn shadow_falls_away_from_the_key_light() {
    // The key light stands to the left of the camera: shadow lies on the right.
    let scene = Scene {
        parts: vec![solid(
            DVec3::new(-0.15, 0.0, -0.15),
            DVec3::new(0.15, 0.5, 0.15),
        )],
        ground: Some(Ground::at(0.0)),
        background: Background::Plain([0.8; 3]),
    };
    let view = View {
        width: 200,
        height: 200,
        pitch: 0.6,
        margin: 0.3,
        ..View::default()
    };
    let camera = Camera::framing(&scene.points(), &view);
    let image = render(
        &scene,
        &camera,
        &Options {
            shadow_map: 512,
            ..quick()
        },
    );
    let floor = |x: f64| {
        let (p, _) = camera.project(DVec3::new(x, 0.0, -0.1));
        pixel(&image, p.x as usize, p.y as usize)[1]
    };
    let (lit, shaded) = (floor(-0.35), floor(0.35));
    assert!(
        f64::from(shaded) < 0.85 * f64::from(lit),
        "{shaded} beside {lit}"
    );
}

#[test]
fn a_transparent_floor_holds_only_its_shadow() {
    let mut scene = clear(vec![solid(
        DVec3::new(-0.15, 0.0, -0.15),
        DVec3::new(0.15, 0.5, 0.15),
    )]);
    scene.ground = Some(Ground::at(0.0));
    let view = View {
        width: 120,
        height: 120,
        pitch: 0.6,
        margin: 0.3,
        ..View::default()
    };
    let camera = Camera::framing(&scene.points(), &view);
    let image = render(&scene, &camera, &quick());
    let (p, _) = camera.project(DVec3::new(0.28, 0.0, -0.1));
    let shade = pixel(&image, p.x as usize, p.y as usize);
    assert!(
        shade[3] > 30 && shade[3] < 250 && shade[..3] == [0; 3],
        "{shade:?}"
    );
    assert_eq!(pixel(&image, 0, 0)[3], 0);
}

#[test]
fn an_overlay_changes_only_what_the_figure_covers() {
    let mut photo = Image::filled(300, 200, [0; 4]);
    for (i, p) in photo.pixels.iter_mut().enumerate() {
        *p = [
            (i * 7 % 256) as u8,
            (i * 13 % 256) as u8,
            (i * 29 % 256) as u8,
            255,
        ];
    }
    let camera = Camera {
        width: 300,
        height: 200,
        centre: DVec2::new(90.0, 120.0),
        ..frontal(200, 2.0)
    };
    let scene = clear(vec![square(0.4, 0.0, painted([0.6, 0.1, 0.1]))]);
    let out = overlay(&photo, &scene, &camera, 0.5);
    let inside = |i: usize| (68..112).contains(&(i % 300)) && (98..142).contains(&(i / 300));
    for i in 0..out.pixels.len() {
        assert!(
            inside(i) || out.pixels[i] == photo.pixels[i],
            "pixel {i} was touched"
        );
    }
    let middle = 120 * 300 + 90;
    assert_ne!(out.pixels[middle], photo.pixels[middle]);
    let other = Image::filled(300, 200, [255; 4]);
    let over_white = overlay(&other, &scene, &camera, 0.5);
    assert!(
        over_white.pixels[middle][2] > out.pixels[middle][2],
        "the photo shows through"
    );
    // What lies behind a transparent pixel is nobody's colour.
    let [red, blue] = [[255, 0, 0, 0], [0, 0, 255, 0]].map(|c| {
        let photo = Image::filled(300, 200, c);
        overlay(&photo, &scene, &camera, 0.5).pixels[middle]
    });
    assert_eq!(red, blue);
    assert!(
        (120..136).contains(&red[3]),
        "half of it is covered: {red:?}"
    );
}

#[test]
fn a_painted_layer_ends_where_its_field_is_zero() {
    let mut part = square(1.0, 0.0, painted([0.8; 3]));
    part.layer = Some(Layer {
        field: part.verts.iter().map(|v| v.x).collect(),
        colour: [0.02; 3],
    });
    let image = render(&clear(vec![part]), &frontal(100, 2.0), &quick());
    let row: Vec<u8> = (28..72).map(|x| pixel(&image, x, 50)[1]).collect();
    assert!(
        row[..21].iter().all(|&v| v > 150) && row[23..].iter().all(|&v| v < 90),
        "{row:?}"
    );
}

#[test]
fn cloth_without_material_coordinates_is_still_drawn() {
    let cloth = Material::cloth([0.2, 0.3, 0.5], Weave::usual(WeaveKind::Twill));
    let image = render(
        &clear(vec![square(0.6, 0.0, cloth)]),
        &frontal(80, 2.0),
        &quick(),
    );
    assert_eq!(pixel(&image, 40, 40)[3], 255);
}
