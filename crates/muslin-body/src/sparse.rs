//! Rows of a few weighted indices each.

/// The `most` strongest of a row's (column, weight) pairs, equal columns added up, made to sum to one.
pub(crate) fn strongest(row: impl Iterator<Item = (u32, f64)>, most: usize) -> Vec<(u32, f64)> {
    let mut sums: Vec<(u32, f64)> = Vec::new();
    for (b, w) in row {
        match sums.iter_mut().find(|s| s.0 == b) {
            Some(s) => s.1 += w,
            None => sums.push((b, w)),
        }
    }
    sums.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
    sums.truncate(most);
    let total: f64 = sums.iter().map(|s| s.1).sum();
    sums.into_iter().map(|(b, w)| (b, w / total)).collect()
}

/// A sparse matrix by rows: which columns, and how much of each.
#[derive(Clone, Debug, PartialEq)]
pub struct Sparse {
    starts: Vec<u32>,
    items: Vec<(u32, f64)>,
}

impl Default for Sparse {
    fn default() -> Self {
        Self {
            starts: vec![0],
            items: Vec::new(),
        }
    }
}

impl Sparse {
    /// No rows yet; [`Sparse::push`] adds them.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a row of (column, weight) pairs.
    pub fn push(&mut self, row: impl IntoIterator<Item = (u32, f64)>) {
        self.items.extend(row);
        self.starts.push(self.items.len() as u32);
    }

    /// The (column, weight) pairs of row `i`.
    pub fn row(&self, i: usize) -> &[(u32, f64)] {
        &self.items[self.starts[i] as usize..self.starts[i + 1] as usize]
    }

    /// How many rows there are.
    pub fn n_rows(&self) -> usize {
        self.starts.len() - 1
    }

    /// Every row, in order.
    pub fn rows(&self) -> impl Iterator<Item = &[(u32, f64)]> {
        self.starts
            .windows(2)
            .map(|w| &self.items[w[0] as usize..w[1] as usize])
    }

    /// The longest row.
    pub fn widest(&self) -> usize {
        self.rows().map(<[_]>::len).max().unwrap_or(0)
    }

    /// Whether every column lies below `n` and every row sums to one.
    pub fn is_convex(&self, n: usize) -> bool {
        let whole = |row: &[(u32, f64)]| {
            let sum: f64 = row.iter().map(|&(_, w)| w).sum();
            (sum - 1.0).abs() < 1e-9 && row.iter().all(|&(c, w)| (c as usize) < n && w >= 0.0)
        };
        self.rows().all(whole)
    }
}
