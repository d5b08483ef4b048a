//! The curve of a training, as comma-separated values.

use muslin_train::{Energies, Told};

/// One line a step.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Log {
    lines: Vec<Told>,
}

const HEAD: &str =
    "step,total_J,membrane_J,bend_J,weight_J,contact_J,pins_J,inertia_J,under_percent";

impl Log {
    /// Adds a step.
    pub fn add(&mut self, told: Told) {
        self.lines.push(told);
    }

    /// The step added last.
    pub fn last(&self) -> Option<Told> {
        self.lines.last().copied()
    }

    /// Forgets what came after `step`.
    pub fn back_to(&mut self, step: u64) {
        self.lines.retain(|t| t.step <= step);
    }

    /// As text.
    pub fn text(&self) -> String {
        let mut out = format!("{HEAD}\n");
        for t in &self.lines {
            let e = t.energies.terms().map(|t| format!("{:e}", t.1)).join(",");
            out += &format!(
                "{},{:e},{e},{:e}\n",
                t.step,
                t.energies.total(),
                100.0 * t.under
            );
        }
        out
    }

    /// From text; lines of another kind are left out.
    pub fn read(text: &str) -> Self {
        let line = |l: &str| {
            let n: Vec<f64> = l
                .split(',')
                .map(|x| x.parse().ok())
                .collect::<Option<_>>()?;
            let [
                step,
                _,
                membrane,
                bend,
                weight,
                contact,
                pins,
                inertia,
                under,
            ] = n.try_into().ok()?;
            Some(Told {
                step: step as u64,
                energies: Energies {
                    membrane,
                    bend,
                    weight,
                    contact,
                    pins,
                    inertia,
                },
                under: under / 100.0,
            })
        };
        Self {
            lines: text.lines().filter_map(line).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_log_read_back_is_the_same_text() {
        let mut log = Log::default();
        for step in 1..4 {
            log.add(Told {
                step,
                under: 0.25,
                ..Told::default()
            });
        }
        assert_eq!(Log::read(&log.text()).text(), log.text());
        assert_eq!(Log::read(&log.text()).last().map(|t| t.step), Some(3));
    }
}
