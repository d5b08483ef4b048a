//! Rows of a few weighted indices each.

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
