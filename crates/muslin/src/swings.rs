//! How a garment swings on somebody: what no network has to learn.

use glam::DVec3;
use muslin_body::{Avatar, Cores, Figure, Pose};
use muslin_geom::Surface;
use muslin_model::{Encoder, Model, Sway};
use muslin_sim::{Cloth, Options, hang};

use crate::drape::NEARLY_THERE;
use crate::failure::{Exit, Failure};
use crate::figure::body_frame;

/// Steps in which cloth comes to hang on the body at rest.
const HUNG: usize = 40;

/// Whether a model is of our own system, whose motion is swings about what the pose tells.
pub(crate) fn are_ours(model: &Model) -> bool {
    matches!(model.encoder, Encoder::Plain(_))
}

/// A model of ours with the swings of a cloth on the figure that its template lies around.
pub(crate) fn swinging(
    model: Model,
    body: (&Avatar, &Figure),
    cloth: &Cloth,
) -> Result<Model, Failure> {
    let wide = |p: &[f32; 3]| DVec3::from_array(p.map(f64::from));
    let template: Vec<DVec3> = model.template.iter().map(wide).collect();
    Ok(Model {
        sway: swings(body, (cloth, &template), &model.bones)?,
        ..model
    })
}

/// The swings of a cloth that starts at some place [m] around a figure at rest and follows these bones; none where it
/// is too small to swing.
pub(crate) fn swings(
    (avatar, figure): (&Avatar, &Figure),
    (cloth, start): (&Cloth, &[DVec3]),
    bones: &[String],
) -> Result<Option<Sway>, Failure> {
    let cores = Cores::new(avatar, figure);
    let body = body_frame(avatar, &avatar.pose(figure, &Pose::rest(avatar)), &cores);
    let options = Options {
        last_steps: HUNG,
        ..NEARLY_THERE
    };
    let hanging = hang(cloth, start, (&body, avatar.collision_faces()), &options);
    let hanging = hanging.map_err(|e| Failure::new(Exit::Numbers, "swings", e.to_string()))?;
    let mut sway = muslin_train::sway(&hanging);
    let skin = Surface::new(&body.skin, avatar.collision_faces());
    let own: Vec<Option<usize>> = bones.iter().map(|b| avatar.bone(b).ok()).collect();
    let follows = |v: u32| {
        let place = |b: u32| own.iter().position(|o| *o == Some(b as usize));
        let row = avatar.rig().weights.row(v as usize).iter();
        row.filter_map(|(b, w)| Some((place(*b)? as u8, *w)))
            .collect()
    };
    if let Some(sway) = &mut sway {
        muslin_train::hold_back(sway, &hanging.verts, (&skin, follows));
    }
    Ok(sway)
}
