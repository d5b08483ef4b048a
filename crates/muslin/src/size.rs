//! Sizes on a label: for whom a garment is cut, whoever wears it.
//!
//! A letter stands for a span of chest girths (EN 13402-3). The garment is cut for somebody in the middle of it, with the
//! waist and the hip that belong to that chest, who is otherwise built like the wearer and as tall.

use muslin_body::{Avatar, BodyError, Figure, GIRTHS, Measures, Shape};
use muslin_garment::Worn;
use muslin_geom::Report;

use crate::failure::{Exit, Failure};
use crate::figure::body_failure;
use crate::outfit::Piece;

/// A letter on a label.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Size {
    /// Extra small.
    Xs,
    /// Small.
    S,
    /// Medium.
    M,
    /// Large.
    L,
    /// Extra large.
    Xl,
    /// Twice that.
    Xxl,
}

/// The spans' ends [cm], men's chest and women's bust, from XS on (EN 13402-3:2004).
const MEN: [f64; 7] = [78.0, 86.0, 94.0, 102.0, 110.0, 118.0, 129.0];
const WOMEN: [f64; 7] = [74.0, 82.0, 90.0, 98.0, 107.0, 119.0, 131.0];

/// Waist and hip by the bust [cm], women (EN 13402-3:2004): of smaller and larger busts by the steps at the ends.
const WOMEN_BY_BUST: [[f64; 3]; 5] = [
    [76.0, 60.0, 84.0],
    [104.0, 88.0, 112.0],
    [110.0, 94.0, 117.0],
    [116.0, 100.0, 122.0],
    [134.0, 118.0, 137.0],
];
/// How much slimmer a man's waist is than his chest [cm] (EN 13402-3:2004).
const DROP: f64 = 12.0;
/// A man's hip by his chest [cm]: slope and beginning of a line through 3,268 men of ANSUR II.
const MENS_HIP: [f64; 2] = [0.733, 24.3];

impl Size {
    /// From the smallest.
    pub const ALL: [Self; 6] = [Self::Xs, Self::S, Self::M, Self::L, Self::Xl, Self::Xxl];

    /// As it stands on a label.
    pub fn label(self) -> &'static str {
        ["XS", "S", "M", "L", "XL", "XXL"][self as usize]
    }

    /// From a label, in any case.
    pub fn parse(text: &str) -> Result<Self, String> {
        let asked = text.trim();
        let same = |s: &Self| s.label().eq_ignore_ascii_case(asked);
        let found = Self::ALL.into_iter().find(same);
        found.ok_or_else(|| "a size is XS, S, M, L, XL or XXL".to_owned())
    }

    /// The middle of its chest girths [m]; `gender` from 0 (male) to 1 (female).
    pub fn chest(self, gender: f64) -> f64 {
        let k = self as usize;
        let middle = |of: [f64; 7]| 0.5 * (of[k] + of[k + 1]) / 100.0;
        (1.0 - gender) * middle(MEN) + gender * middle(WOMEN)
    }

    /// Chest, waist and hip [m] of somebody in the middle of it; `gender` from 0 (male) to 1 (female).
    pub fn girths(self, gender: f64) -> [f64; 3] {
        let (him, her) = (self.chest(0.0) * 100.0, self.chest(1.0) * 100.0);
        let man = [him, him - DROP, MENS_HIP[0] * him + MENS_HIP[1]];
        let above = WOMEN_BY_BUST.iter().position(|row| her < row[0]);
        let k = above
            .unwrap_or(usize::MAX)
            .clamp(1, WOMEN_BY_BUST.len() - 1);
        let [from, to] = [WOMEN_BY_BUST[k - 1], WOMEN_BY_BUST[k]];
        let t = (her - from[0]) / (to[0] - from[0]);
        std::array::from_fn(|i| {
            let woman = from[i] + t * (to[i] - from[i]);
            ((1.0 - gender) * man[i] + gender * woman) / 100.0
        })
    }

    /// The size whose girths are nearest to a chest [m].
    pub fn of(chest: f64, gender: f64) -> Self {
        let far = |s: &Self| (s.chest(gender) - chest).abs();
        let nearest = Self::ALL
            .into_iter()
            .min_by(|a, b| far(a).total_cmp(&far(b)));
        nearest.expect("there are sizes")
    }
}

/// Somebody whom garments are cut for that another wears.
#[derive(Clone, Debug)]
pub(crate) struct CutFor {
    /// What the label says; none where it was drawn at random.
    pub size: Option<Size>,
    /// At rest.
    pub figure: Figure,
    /// As they stand to be dressed.
    pub stood: Figure,
    pub measures: Measures,
    /// Who wears it, at rest.
    pub worn_by: Figure,
    pub wearer: Measures,
}

/// Weights beyond all bodies, and how far inside of the least and the most [kg].
const BEYOND: [f64; 2] = [1.0, 1e4];
const INSIDE: f64 = 0.02;

/// The least and the most that somebody may weigh [kg].
fn reach(weighing: impl Fn(f64) -> Result<(), BodyError>) -> Result<[f64; 2], BodyError> {
    let end = |kg: f64| match weighing(kg) {
        Err(BodyError::MassOutOfReach { least, most, .. }) => Ok(match kg < least {
            true => least + INSIDE,
            false => most - INSIDE,
        }),
        Err(e) => Err(e),
        Ok(()) => Ok(kg),
    };
    Ok([end(BEYOND[0])?, end(BEYOND[1])?])
}

/// Garments cut for somebody so much slimmer than their wearer are said to be too small [cm].
const TIGHT: f64 = 6.0;
/// Halvings in which a weight is found for girths.
const HALVINGS: usize = 12;
/// Halvings in which a slider is found for a girth.
const FINE: usize = 10;
/// As near must the chest of somebody for whom a size is cut be to its own [m].
const NEAR: f64 = 0.005;

/// Somebody who wears things: our own body, or a character in whose likeness it is, and then our body as it is.
#[derive(Clone, Copy)]
pub(crate) struct Wearer<'a> {
    pub avatar: &'a Avatar,
    /// Of our own body; a character has its own.
    pub shape: &'a Shape,
    /// At rest.
    pub figure: &'a Figure,
    pub base: Option<&'a Avatar>,
}

impl Wearer<'_> {
    /// Our body as tall as the wearer and built alike, of another weight [kg].
    fn weighing(&self, kg: f64) -> Result<Shape, BodyError> {
        (self.shape).with_mass(self.base.unwrap_or(self.avatar), kg)
    }

    /// The wearer's twin of another weight [kg] with sliders pushed further: for chest, waist and hip.
    pub fn built(&self, kg: f64, pushed: [f64; 3]) -> Result<Figure, BodyError> {
        self.twins()?(&further(&self.weighing(kg)?, pushed))
    }

    /// The least and the most that a twin of the wearer may weigh [kg].
    pub fn reach(&self) -> Result<[f64; 2], BodyError> {
        reach(|kg| self.weighing(kg).map(|_| ()))
    }

    /// The wearer's twins, by our body's shape.
    ///
    /// A character grows as our body would, in proportion to its height.
    fn twins(&self) -> Result<impl Fn(&Shape) -> Result<Figure, BodyError>, BodyError> {
        let ours = self.base.unwrap_or(self.avatar);
        let usual = match self.base {
            Some(_) => {
                let scale = self.avatar.height(self.figure) / ours.height_of(self.shape)?;
                Some((ours.figure(self.shape)?, scale))
            }
            None => None,
        };
        Ok(move |shape: &Shape| {
            let grown = ours.figure(shape)?;
            let Some((usual, scale)) = &usual else {
                return Ok(grown);
            };
            let pairs = grown.verts.iter().zip(&usual.verts);
            let moves = pairs.map(|(g, u)| (*g - *u) * *scale);
            Ok(Figure {
                verts: (self.figure.verts.iter().zip(moves))
                    .map(|(p, m)| *p + m)
                    .collect(),
                ..self.figure.clone()
            })
        })
    }

    /// The twin of these girths [m], chest, waist and hip, as nearly as our body goes: of the weight that makes their
    /// sum, and from there by a slider for each.
    fn of_girths(&self, asked: [f64; 3]) -> Result<Figure, BodyError> {
        let twin = self.twins()?;
        let girths = |shape: &Shape| -> Result<[f64; 3], BodyError> {
            Ok(self.avatar.measure(&twin(shape)?).girths())
        };
        let [mut low, mut high] = self.reach()?;
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            let sum = |g: [f64; 3]| g.iter().sum::<f64>();
            match sum(girths(&self.weighing(middle)?)?) < sum(asked) {
                true => low = middle,
                false => high = middle,
            }
        }
        let shape = self.weighing(0.5 * (low + high))?;
        let (mut least, mut most) = ([0.0; 3], [0.0; 3]);
        // A belly counts as chest and hip where it is the fullest, so the waist comes first.
        for own in [&[1][..], &[0, 2]] {
            own.iter().for_each(|&k| (least[k], most[k]) = (-2.0, 2.0));
            for _ in 0..FINE {
                let middle = halfway(least, most);
                let now = girths(&further(&shape, middle))?;
                for &k in own {
                    match now[k] < asked[k] {
                        true => least[k] = middle[k],
                        false => most[k] = middle[k],
                    }
                }
            }
        }
        twin(&further(&shape, halfway(least, most)))
    }

    /// What our body weighs where nothing else is asked for [kg].
    pub fn mass(&self) -> Result<f64, BodyError> {
        let ours = self.base.unwrap_or(self.avatar);
        Ok(ours.measure(&ours.figure(self.shape)?).mass)
    }
}

fn halfway(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|k| 0.5 * (a[k] + b[k]))
}

/// A shape with its girths' sliders pushed further, to their ends at most.
fn further(shape: &Shape, pushed: [f64; 3]) -> Shape {
    GIRTHS
        .iter()
        .zip(pushed)
        .fold(shape.clone(), |shape, (name, by)| {
            let value = (shape.local(name) + by).clamp(-1.0, 1.0);
            shape.with_local(name, value)
        })
}

impl CutFor {
    /// The figure of a size for a wearer.
    pub fn size(who: Wearer<'_>, size: Size) -> Result<Self, Failure> {
        let fault = |e| body_failure(&e);
        let asked = size.girths(who.shape.get("gender").map_err(fault)?);
        let figure = who.of_girths(asked).map_err(fault)?;
        let cut = Self::new(who, Some(size), figure);
        let chest = asked[0];
        if (cut.measures.chest - chest).abs() < NEAR {
            return Ok(cut);
        }
        let end = |kg: f64, pushed: f64| {
            let figure = who.built(kg, [pushed; 3]).map_err(fault)?;
            Ok(who.avatar.measure(&figure).chest * 100.0)
        };
        let [low, high] = who.reach().map_err(fault)?;
        let what = format!(
            "size {} is for a chest of {:.0} cm; at {:.0} cm tall {} has {:.0} to {:.0} cm",
            size.label(),
            chest * 100.0,
            who.avatar.height(who.figure) * 100.0,
            if who.base.is_some() {
                "this character"
            } else {
                "our body"
            },
            end(low, -2.0)?,
            end(high, 2.0)?
        );
        Err(Failure::new(Exit::Invalid, "size", what)
            .at("--size")
            .hint("take a nearer size, or another --height"))
    }

    /// For somebody of this figure, at rest.
    pub fn new(who: Wearer<'_>, size: Option<Size>, figure: Figure) -> Self {
        Self {
            size,
            stood: who.avatar.dressing_beside(who.figure, &figure),
            measures: who.avatar.measure(&figure),
            wearer: who.avatar.measure(who.figure),
            worn_by: who.figure.clone(),
            figure,
        }
    }

    /// How much wider it is cut than the wearer is: chest, waist, hip [m].
    pub fn wider(&self) -> [f64; 3] {
        let (cut, own) = (self.measures.girths(), self.wearer.girths());
        std::array::from_fn(|k| cut[k] - own[k])
    }

    /// What is to be said where it is far narrower than the wearer.
    pub fn tight(&self) -> Option<String> {
        let wider = self.wider().map(|x| x * 100.0);
        if wider.iter().all(|x| *x > -TIGHT) {
            return None;
        }
        let label = self
            .size
            .map_or("this".to_owned(), |s| format!("size {}", s.label()));
        let [chest, waist, hip] = wider;
        Some(format!(
            "{label} is too small for its wearer: it is cut for a chest of {chest:+.0}, a waist of {waist:+.0} and a hip of {hip:+.0} cm beside theirs"
        ))
    }

    /// Whose size a waistband has: the wearer's where it would be too wide.
    pub fn held_by(&self) -> &Figure {
        match self.measures.waist > self.wearer.waist {
            true => &self.worn_by,
            false => &self.figure,
        }
    }

    /// For the report.
    pub fn report(&self) -> Report {
        let mut r = Report::default();
        if let Some(size) = self.size {
            r.set("label", size.label());
        }
        let cm = |x: f64| (x * 1e3).round() / 10.0;
        let names = ["chest", "waist", "hip"];
        for (name, x) in names.iter().zip(self.measures.girths()) {
            r.set(&format!("for_{name}_cm"), cm(x));
        }
        for (name, x) in names.iter().zip(self.wider()) {
            r.set(&format!("wider_than_wearer_{name}_cm"), cm(x));
        }
        r
    }

    /// A garment as the wearer has it on, of what it is like on the wearer if made to measure and on whom it
    /// is cut for: cloth of the latter's size, where that is slimmer around the wearer, else around the
    /// latter, but for a band, which is drawn in.
    pub fn taken_over(&self, piece: &Piece, (own, cut): (Worn, Worn)) -> Worn {
        let looser = self.wider().iter().sum::<f64>() > 0.0;
        let verts = match looser {
            true => {
                let slack = piece.garment.slack(&own.verts);
                let pairs = own.verts.iter().zip(&cut.verts).zip(slack);
                pairs.map(|((own, cut), t)| own.lerp(*cut, t)).collect()
            }
            false => own.verts,
        };
        Worn {
            verts,
            rest: cut.rest,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_are_read_and_grow_and_others_refused() {
        for gender in [0.0, 0.5, 1.0] {
            let chests = Size::ALL.map(|s| s.chest(gender));
            assert!(chests.windows(2).all(|w| w[1] > w[0] + 0.07), "{chests:?}");
            for size in Size::ALL {
                assert_eq!(Size::of(size.chest(gender) + 0.03, gender), size);
                assert_eq!(Size::parse(&size.label().to_lowercase()), Ok(size));
            }
        }
        assert_eq!((Size::M.chest(0.0), Size::M.chest(1.0)), (0.98, 0.94));
        assert!(Size::parse("38").expect_err("no letter").contains("XXL"));
    }

    #[test]
    fn girths_grow_evenly_from_letter_to_letter() {
        let close = |a: [f64; 3], b: [f64; 3]| a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 6e-4);
        assert!(close(Size::M.girths(1.0), [0.94, 0.78, 1.02]));
        assert!(close(Size::Xl.girths(1.0), [1.13, 0.97, 1.195]));
        assert!(close(Size::M.girths(0.0), [0.98, 0.86, 0.9613]));
        for gender in [0.0, 0.5, 1.0] {
            for two in Size::ALL.windows(2) {
                let [from, to] = [two[0].girths(gender), two[1].girths(gender)];
                assert!((to[0] - two[1].chest(gender)).abs() < 1e-9);
                for k in 0..3 {
                    let share = (to[k] - from[k]) / (to[0] - from[0]);
                    assert!((0.7..=1.01).contains(&share), "{two:?} {k}: {share}");
                }
            }
        }
    }

    #[test]
    fn somebody_of_a_size_has_its_girths_and_the_wearers_height() {
        let avatar = Avatar::embedded().expect("the embedded body decodes");
        let shape = Shape::default().with("gender", 1.0).expect("a phenotype");
        let shape = shape.with_height(&avatar, 1.7).expect("in reach");
        for size in [Size::S, Size::Xl] {
            let who = Wearer {
                avatar: &avatar,
                shape: &shape,
                figure: &avatar.figure(&shape).expect("a figure"),
                base: None,
            };
            let cut = CutFor::size(who, size).expect("in reach");
            for (has, asked) in cut.measures.girths().iter().zip(size.girths(1.0)) {
                assert!((has - asked).abs() < 2e-3, "{has} {asked}");
            }
            assert!((cut.measures.height - 1.7).abs() < 1e-3);
            assert_eq!(cut.wider()[0] > 0.0, size == Size::Xl, "{:?}", cut.wider());
        }
    }
}
