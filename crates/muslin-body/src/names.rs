//! Names that are nearly the one that was typed.

/// Up to six of `known`, the most alike first.
///
/// Alike means few single-letter edits, of the whole name or of one of its words, where a name that contains the asked one
/// counts as near.
pub fn nearest<'a>(asked: &str, known: impl Iterator<Item = &'a str>) -> Vec<String> {
    let asked = asked.to_lowercase();
    let mut by: Vec<(usize, &str)> = known
        .map(|k| (unlike(&asked, &k.to_lowercase()), k))
        .collect();
    by.sort();
    by.into_iter().take(6).map(|(_, k)| k.to_string()).collect()
}

fn unlike(asked: &str, known: &str) -> usize {
    let holds = !asked.is_empty() && known.contains(asked);
    let words = known
        .split(['-', '_', ' '])
        .map(|word| edits(asked, word) + 1);
    let far = words.fold(edits(asked, known), usize::min);
    if holds { far / 4 } else { far }
}

/// Levenshtein's distance.
fn edits(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, ca) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for j in 0..b.len() {
            let change = diagonal + usize::from(ca != b[j]);
            diagonal = row[j + 1];
            row[j + 1] = change.min(diagonal + 1).min(row[j] + 1);
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_typing_slip_finds_its_name() {
        let known = ["measure-waist-circ", "measure-hips-circ", "head-oval"];
        assert_eq!(
            nearest("mesure-waist-circ", known.into_iter())[0],
            "measure-waist-circ"
        );
        assert_eq!(nearest("hips", known.into_iter())[0], "measure-hips-circ");
        let fabrics = ["denim", "wool-suiting", "cotton-jersey", "cotton-shirting"];
        let near = nearest("cottn", fabrics.into_iter());
        assert_eq!(near[..2], ["cotton-jersey", "cotton-shirting"]);
        assert_eq!(edits("kitten", "sitting"), 3);
    }
}
