//! What lies around each vertex of cloth, which gives its normal.

/// Neighbours of every vertex, fan by fan.
#[derive(Clone, Debug, Default)]
pub(crate) struct Fans {
    /// Where each place's fans start, and the end of the last.
    pub starts: Vec<u32>,
    /// Where each fan's neighbours start, and the end of the last.
    pub spans: Vec<u32>,
    /// Places around a vertex, in the sense of its faces: each and the next make a face with it. A closed fan ends with
    /// whom it began.
    pub around: Vec<u32>,
}

impl Fans {
    /// Of faces that join so many places.
    pub fn new(faces: &[[u32; 3]], n: usize) -> Self {
        let mut sides: Vec<Vec<[u32; 2]>> = vec![Vec::new(); n];
        for &[a, b, c] in faces {
            for [v, p, q] in [[a, b, c], [b, c, a], [c, a, b]] {
                sides[v as usize].push([p, q]);
            }
        }
        let mut out = Self {
            starts: vec![0],
            spans: vec![0],
            around: Vec::new(),
        };
        for own in &mut sides {
            out.chain(own);
            out.starts.push(out.spans.len() as u32 - 1);
        }
        out
    }

    /// Adds the fans that some sides of faces make.
    fn chain(&mut self, sides: &mut Vec<[u32; 2]>) {
        while !sides.is_empty() {
            // Where an open fan starts nobody ends.
            let starts = |s: &[u32; 2]| sides.iter().all(|other| other[1] != s[0]);
            let first = sides.iter().position(starts).unwrap_or(0);
            let [p, mut last] = sides.swap_remove(first);
            self.around.extend([p, last]);
            while let Some(next) = sides.iter().position(|s| s[0] == last) {
                last = sides.swap_remove(next)[1];
                self.around.push(last);
            }
            self.spans.push(self.around.len() as u32);
        }
    }

    /// The fans at a place.
    #[inline(always)]
    pub fn of(&self, place: usize) -> impl Iterator<Item = &[u32]> {
        let own = self.starts[place] as usize..self.starts[place + 1] as usize;
        let spans = self.spans[own.start..=own.end].windows(2);
        spans.map(|s| &self.around[s[0] as usize..s[1] as usize])
    }
}
