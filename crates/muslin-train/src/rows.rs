//! Lists of lists in one piece.

/// Where each row starts, and where the last ends; and what is in them.
pub fn flat<T: Copy>(rows: &[Vec<T>]) -> (Vec<u32>, Vec<T>) {
    let mut starts = vec![0];
    for row in rows {
        starts.push(starts[starts.len() - 1] + row.len() as u32);
    }
    (starts, rows.concat())
}
