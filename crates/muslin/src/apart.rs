//! What a job reads it never writes over.

use std::path::{Path, PathBuf};

use crate::brought::{is_file, numbered};
use crate::fabric;
use crate::failure::{Exit, Failure};
use crate::options::DressOptions;

/// Refuses results that would be written over a file that the job reads.
pub(crate) fn apart(
    read: &[PathBuf],
    made: impl IntoIterator<Item = PathBuf>,
) -> Result<(), Failure> {
    let read: Vec<PathBuf> = read.iter().filter_map(|p| full(p)).collect();
    for file in made {
        if full(&file).is_some_and(|file| read.contains(&file)) {
            let what = format!("{} is read, and would be written over", file.display());
            let fault = Failure::new(Exit::Usage, "same-file", what).at("--out");
            return Err(fault.hint("name another file or folder for the results"));
        }
    }
    Ok(())
}

/// A file, however it is named.
pub(crate) fn full(path: &Path) -> Option<PathBuf> {
    let there = path.canonicalize();
    there.or_else(|_| std::path::absolute(path)).ok()
}

/// The files that who wears what is read from.
pub(crate) fn worn(options: &DressOptions) -> Vec<PathBuf> {
    let mut read: Vec<PathBuf> = options.body.iter().cloned().collect();
    for wear in &options.outfit {
        if is_file(&wear.garment) {
            read.push(numbered(&wear.garment).0.into());
        }
        let cloth = wear.fabric.as_ref().filter(|f| fabric::is_file(f));
        read.extend(cloth.map(PathBuf::from));
    }
    read
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::options::Wear;

    #[test]
    fn a_file_is_itself_by_whatever_name() {
        let folder = std::env::temp_dir().join(format!("muslin-apart-{}", std::process::id()));
        std::fs::create_dir_all(folder.join("in")).expect("a temporary folder");
        let file = folder.join("front.png");
        std::fs::write(&file, "a photo").expect("a small file");
        let read = [file.clone()];
        assert_eq!(apart(&read, [folder.join("look.glb")]), Ok(()));
        for same in [file.clone(), folder.join("in/../front.png")] {
            let fault = apart(&read, [folder.join("look.glb"), same]).expect_err("it is read");
            assert_eq!((fault.exit, fault.code), (Exit::Usage, "same-file"));
        }
        #[cfg(unix)]
        {
            let link = folder.join("link.png");
            std::os::unix::fs::symlink(&file, &link).expect("a link");
            assert!(apart(&read, [link]).is_err());
        }
        std::fs::remove_dir_all(&folder).expect("our own folder");
    }

    #[test]
    fn garments_and_fabrics_from_files_are_read() {
        let options = DressOptions {
            outfit: ["tee:denim", "a/suit.obj#2:my.toml"]
                .map(Wear::parse)
                .into(),
            body: Some("hero.glb".into()),
            ..DressOptions::default()
        };
        let read = ["hero.glb", "a/suit.obj", "my.toml"].map(PathBuf::from);
        assert_eq!(worn(&options), read);
    }
}
