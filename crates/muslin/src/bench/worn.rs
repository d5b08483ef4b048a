//! Garments on a moving body: how fast our own are and how that grows with their vertices, and whether garments
//! of files get through a walk.

use std::path::{Path, PathBuf};

use muslin_io::Clip;
use muslin_sim::BEYOND_LIMIT;

use super::clock::load;
use super::whole::picture;
use crate::evaluate::evaluate;
use crate::failure::Failure;
use crate::options::{DressOptions, Wear};
use crate::simulate::quality::Quality;
use crate::simulate::set::Set;
use crate::simulate::{SimulateOptions, filmed};
use crate::table::Table;
use crate::watch::Watch;

/// Our own garments with their triangle edges [mm] (more than five and than twelve thousand vertices), motions, and
/// what a frame may take [ms].
const PACES: [((&str, f64), &str, f64); 4] = [
    (TEE, "walk", 35.0),
    (TEE, "dance", 35.0),
    (DRESS, "walk", 100.0),
    (DRESS, "dance", 100.0),
];
const TEE: (&str, f64) = ("tee", 12.9);
const DRESS: (&str, f64) = ("dress", 10.8);
/// Triangle edges of a walking tee [mm]: from fifteen hundred vertices to over twenty thousand.
const EDGES: [f64; 5] = [24.0, 17.0, 12.0, 8.5, 6.0];
/// How long they move [s].
const SECONDS: f64 = 1.5;

/// What garments of files walk by.
const WALK: &str = "motion/cmu-bvh/02_01_walk.bvh";
/// Garments of files under `garments/`.
const FILES: [&str; 12] = [
    "garmentcode-patterns/shirt_mean_specification.json",
    "garmentcode-patterns/dress_pencil_specification.json",
    "garmentcode-patterns/js_mean_all_specification.json",
    "diffcloth/tshirt1900.obj",
    "diffcloth/skirt2011.obj",
    "diffcloth/dress-v5k-f10k-v3.obj",
    "makehuman/female_casualsuit01.obj",
    "makehuman/female_elegantsuit01.obj",
    "makehuman/male_casualsuit01.obj",
    "makehuman/male_casualsuit02.obj",
    "makehuman/male_casualsuit04.obj",
    "makehuman/male_elegantsuit01.obj",
];
/// Recordings under `motion/`, and where in them to begin [s]: of each [`TAKEN`] seconds.
const SEQUENCES: [(&str, f64); 20] = [
    ("cmu-bvh/01_01_playground_forward-jumps_turn.bvh", 2.0),
    ("cmu-bvh/01_01_playground_forward-jumps_turn.bvh", 12.0),
    ("cmu-bvh/01_03_playground_climb_hang_swing.bvh", 4.0),
    ("cmu-bvh/02_01_walk.bvh", 0.4),
    ("cmu-bvh/05_06_dance-modern.bvh", 0.0),
    ("cmu-bvh/05_06_dance-modern.bvh", 3.0),
    ("cmu-fbx-as-bvh/07_01_walk.bvh", 0.3),
    ("cmu-fbx-as-bvh/49_08_cartwheel.bvh", 1.5),
    ("cmu-fbx-as-bvh/55_01_dance.bvh", 5.0),
    ("cmu-fbx-as-bvh/85_03_acrobatics.bvh", 9.0),
    ("cmu-fbx-as-bvh/85_04_acrobatics.bvh", 9.0),
    ("cmu-fbx-as-bvh/85_12_acrobatics.bvh", 9.0),
    ("cmu-fbx-as-bvh/85_14_acrobatics.bvh", 9.0),
    ("cmu-fbx-as-bvh/91_48_locomotion.bvh", 1.0),
    ("cmu-fbx-as-bvh/91_49_locomotion.bvh", 1.0),
    ("cmu-fbx-as-bvh/91_50_locomotion.bvh", 1.0),
    ("cmu-fbx-as-bvh/91_51_locomotion.bvh", 1.0),
    ("cmu-fbx-as-bvh/91_52_locomotion.bvh", 1.0),
    ("cmu-fbx-as-bvh/91_53_locomotion.bvh", 1.0),
    ("cmu-fbx-as-bvh/91_54_locomotion.bvh", 1.0),
];
const TAKEN: f64 = 2.0;
/// What is worn in each of them.
const WORN: [&str; 3] = ["tee", "trousers", "dress"];
/// What `cargo xtask peers` makes of Newton's example shirt.
const SHIRT: &str = "newton_shirt.obj";

/// Where things are, and what is asked for.
#[derive(Clone, Debug, Default)]
pub struct Walks {
    /// The data folder; without it files do not walk.
    pub data: Option<PathBuf>,
    /// The folder of other programs, for Newton's shirt.
    pub peers: Option<PathBuf>,
    /// How often what is timed is timed.
    pub rounds: usize,
    /// Only parts whose name holds one of these; all if empty.
    pub only: Vec<String>,
    /// Folder for a picture of every last frame.
    pub pictures: Option<PathBuf>,
}

/// One garment or outfit in one motion.
struct Case {
    name: String,
    options: SimulateOptions,
    /// How often.
    rounds: usize,
    /// What a frame may take [ms].
    most: Option<f64>,
    /// Whether it is left out where nothing is named: all of those take an hour or more.
    is_long: bool,
}

impl Walks {
    /// Whether something of that name is asked for.
    pub fn asks(&self, name: &str) -> bool {
        self.only.is_empty() || self.names(name)
    }

    fn names(&self, name: &str) -> bool {
        let name = name.to_lowercase();
        self.only.iter().any(|o| name.contains(&o.to_lowercase()))
    }

    fn cases(&self) -> Vec<Case> {
        let timed = |name: String, (garment, edge): (&str, f64), motion: &str, most| {
            let mut options = moving(garment, motion, Some(SECONDS));
            options.dress.edge = edge / 1000.0;
            Case {
                name,
                options,
                rounds: self.rounds.max(1),
                most,
                is_long: false,
            }
        };
        let pace = PACES.iter().map(|&(worn, motion, most)| {
            let name = format!("pace, {}, {motion}", worn.0);
            timed(name, worn, motion, Some(most))
        });
        let scaling = EDGES.iter().map(|&edge| {
            let name = format!("scaling, tee, {edge} mm");
            timed(name, ("tee", edge), "walk", None)
        });
        let all = pace
            .chain(scaling)
            .chain(self.files())
            .chain(self.sequences());
        let asked = |c: &Case| match c.is_long {
            true => self.names(&c.name),
            false => self.asks(&c.name),
        };
        all.filter(asked).collect()
    }

    /// Two seconds of twenty recordings in three garments.
    fn sequences(&self) -> Vec<Case> {
        let Some(data) = &self.data else {
            return Vec::new();
        };
        let of = |(motion, start): (&str, f64), garment: &str| {
            let file = data.join("motion").join(motion);
            let mut options = moving(garment, &file.to_string_lossy(), Some(TAKEN));
            options.start = start;
            Case {
                name: format!("sequence, {garment}, {} from {start:.1} s", called(&file)),
                options,
                rounds: 1,
                most: None,
                is_long: true,
            }
        };
        (SEQUENCES.iter().flat_map(|&s| WORN.map(|w| of(s, w)))).collect()
    }

    fn files(&self) -> Vec<Case> {
        let Some(data) = &self.data else {
            return Vec::new();
        };
        let motion = data.join(WALK).to_string_lossy().into_owned();
        let shirt = self.peers.iter().map(|p| p.join(SHIRT));
        let files = FILES.iter().map(|f| data.join("garments").join(f));
        let one = |file: PathBuf| Case {
            name: format!("walk, {}", called(&file)),
            options: moving(&file.to_string_lossy(), &motion, None),
            rounds: 1,
            most: None,
            is_long: false,
        };
        files
            .chain(shirt.filter(|s| s.is_file()))
            .map(one)
            .collect()
    }
}

/// A file's own name.
fn called(file: &Path) -> String {
    muslin_io::name(Path::new(file.file_name().unwrap_or_default()))
}

/// A garment as it comes, at 60 frames a second; what is wrong with it is told and not refused.
fn moving(garment: &str, motion: &str, seconds: Option<f64>) -> SimulateOptions {
    SimulateOptions {
        motion: motion.to_owned(),
        seconds,
        dress: DressOptions {
            outfit: vec![Wear::parse(garment)],
            allow_crossings: true,
            ..DressOptions::default()
        },
        ..SimulateOptions::default()
    }
}

const HEADS: [&str; 10] = [
    "case",
    "vertices",
    "frames",
    "ms a frame (slowest)",
    "to be",
    "frames in body",
    "deeper than 0.5 mm",
    "frames crossing",
    "stretch % (limit), frames beyond",
    "holds",
];

/// Everything that is asked for, as a table; nothing where nothing is.
///
/// # Errors
/// Interrupted. What the simulator refuses is a row that does not hold.
pub fn worn(walks: &Walks, watch: &mut Watch) -> Result<String, Failure> {
    let cases = walks.cases();
    if cases.is_empty() {
        return Ok(String::new());
    }
    let mut table = Table::new(&HEADS);
    for (k, case) in cases.iter().enumerate() {
        watch.progress(&case.name);
        let (row, told) = match rounds(case, walks, watch) {
            Ok(found) => (found.row(case), found.told(case)),
            Err(e) => {
                watch.go_on()?;
                (refused(case, &e), e.to_string().replace('\n', " "))
            }
        };
        table.row(row);
        let told = format!("{}: {told}", case.name);
        watch.done((k + 1, cases.len()), "motion", told)?;
    }
    Ok(format!(
        "{}\n{}\nms a frame: the least of the rounds' medians; deeper: points of cloth over all frames; holds: nothing \
         in the body, deeper\nor crossing, no face stretched beyond its fabric's limit and {:.0} %, and as fast as it is to be\n",
        table.text(),
        load(),
        BEYOND_LIMIT * 100.0,
    ))
}

fn refused(case: &Case, e: &Failure) -> [String; HEADS.len()] {
    let mut row: [String; HEADS.len()] = Default::default();
    row[0] = case.name.clone();
    row[3] = format!("{}: {}", e.code, e.what.replace('\n', " "));
    row[HEADS.len() - 1] = "no".into();
    row
}

/// What one case came to.
struct Found {
    vertices: usize,
    frames: usize,
    /// The least of the medians, and the slowest frame of that round [ms].
    pace: [f64; 2],
    quality: Quality,
    deeper: f64,
}

impl Found {
    fn of(clip: &Clip, quality: &Quality) -> Result<Self, Failure> {
        let deeper = evaluate(clip, None)?.figure("contact", "deeper_than_half_a_mm");
        Ok(Self {
            vertices: clip.n_verts(),
            frames: clip.drape.frames.len(),
            pace: quality.pace(),
            quality: quality.clone(),
            deeper,
        })
    }

    fn in_body(&self) -> usize {
        self.quality.faulty()[0]
    }

    fn crossing(&self) -> usize {
        self.quality.faulty()[1]
    }

    fn is_clean(&self) -> bool {
        let strained = self
            .quality
            .strained
            .iter()
            .map(|s| s.beyond)
            .sum::<usize>();
        self.in_body() + self.crossing() + strained == 0 && self.deeper == 0.0
    }

    fn holds(&self, case: &Case) -> bool {
        self.is_clean() && case.most.is_none_or(|most| self.pace[0] <= most)
    }

    fn stretch(&self) -> String {
        let one = |s: &crate::simulate::quality::Strained| {
            let limit = s
                .limit
                .map_or("none".into(), |l| format!("{:.1}", 100.0 * l));
            format!("{:.1} ({limit}), {}", 100.0 * s.max, s.beyond)
        };
        let all = self.quality.strained.iter().map(one);
        all.collect::<Vec<_>>().join("; ")
    }

    fn row(&self, case: &Case) -> [String; HEADS.len()] {
        [
            case.name.clone(),
            self.vertices.to_string(),
            self.frames.to_string(),
            format!("{:.0} ({:.0})", self.pace[0], self.pace[1]),
            case.most.map_or(String::new(), |m| format!("{m:.0}")),
            self.in_body().to_string(),
            self.deeper.to_string(),
            self.crossing().to_string(),
            self.stretch(),
            if self.holds(case) { "yes" } else { "no" }.into(),
        ]
    }

    fn told(&self, case: &Case) -> String {
        let [
            _,
            vertices,
            frames,
            pace,
            _,
            body,
            deeper,
            crossing,
            stretch,
            holds,
        ] = self.row(case);
        format!(
            "{vertices} vertices, {frames} frames, {pace} ms; {body} in the body, {deeper} points deeper than 0.5 mm, \
             {crossing} crossing; stretch {stretch}; holds: {holds}"
        )
    }
}

/// Simulates a case as often as it is to be, and judges the first time: all give the same bits.
fn rounds(case: &Case, walks: &Walks, watch: &Watch) -> Result<Found, Failure> {
    let mut found: Option<Found> = None;
    for round in 0..case.rounds {
        let judge = |set: &Set, clip: &Clip, quality: &Quality| -> Result<(), Failure> {
            match &mut found {
                Some(first) => {
                    let pace = quality.pace();
                    if pace[0] < first.pace[0] {
                        first.pace = pace;
                    }
                }
                None => found = Some(Found::of(clip, quality)?),
            }
            match &walks.pictures {
                Some(folder) if round == 0 => last_frame(folder, (set, clip), &case.name),
                _ => Ok(()),
            }
        };
        filmed(&case.options, &mut watch.quiet(), judge)?;
    }
    Ok(found.expect("there is a round"))
}

/// Front picture of a clip's last frame, named like the case.
fn last_frame(folder: &Path, (set, clip): (&Set, &Clip), name: &str) -> Result<(), Failure> {
    let last = clip.drape.frames.len() - 1;
    let body = set.seen(last, &clip.body[last]);
    let worn = (&set.outfit, clip.drape.frames[last].as_slice());
    picture(folder, (set.avatar, &body), worn, name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::quality::Strained;

    #[test]
    fn parts_are_asked_for_by_name_and_files_walk_where_there_is_data() {
        let names =
            |walks: Walks| -> Vec<String> { walks.cases().into_iter().map(|c| c.name).collect() };
        let all = names(Walks::default());
        assert_eq!(all.len(), PACES.len() + EDGES.len());
        let only = |name: &str| Walks {
            data: Some("data".into()),
            only: vec![name.to_owned()],
            ..Walks::default()
        };
        assert_eq!(names(only("walk, ")).len(), FILES.len());
        let sequences = names(only("sequence, "));
        assert_eq!(sequences.len(), SEQUENCES.len() * WORN.len());
        assert!(
            !names(Walks {
                data: Some("data".into()),
                ..Walks::default()
            })
            .iter()
            .any(|n| sequences.contains(n))
        );
        assert_eq!(names(only("pace, dress, walk")), ["pace, dress, walk"]);
    }

    #[test]
    fn a_speed_counts_only_where_the_cloth_is_clean() {
        let case = Case {
            name: "pace".into(),
            options: SimulateOptions::default(),
            rounds: 1,
            most: Some(35.0),
            is_long: false,
        };
        let found = |pace, deeper, beyond| Found {
            vertices: 4,
            frames: 2,
            pace: [pace, pace],
            quality: Quality {
                crossings: vec![0, 0],
                strained: vec![Strained {
                    beyond,
                    ..Strained::default()
                }],
                ..Quality::default()
            },
            deeper,
        };
        assert!(found(34.0, 0.0, 0).holds(&case));
        for bad in [
            found(36.0, 0.0, 0),
            found(34.0, 1.0, 0),
            found(34.0, 0.0, 1),
        ] {
            assert!(!bad.holds(&case));
        }
    }
}
