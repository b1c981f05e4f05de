//! The pictures of the manual that `docs/pictures/draw.py` draws show what the program computes now.

use crate::support::program::{ERA, build_isolated_command, run_command};
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

/// The mark of `docs/pictures/canvas.py` in each picture.
const DRAWN: &str = "drawn by docs/pictures/draw.py";
/// What the script prints after the name of a picture that it has compared.
const UP_TO_DATE: &str = " is up to date";

/// The files of `docs/src/images` with the mark.
fn list_drawn_pictures(root: &Path) -> BTreeSet<String> {
    let mut drawn = BTreeSet::new();
    for entry in fs::read_dir(root.join("docs/src/images")).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|extension| extension == "svg")
            && fs::read_to_string(&path).unwrap().contains(DRAWN)
        {
            drawn.insert(path.file_name().unwrap().to_str().unwrap().to_owned());
        }
    }
    drawn
}

#[test]
fn all_drawn_pictures_are_up_to_date() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut command = build_isolated_command("python3");
    // -B: no compiled files beside the script.
    command.current_dir(&root).args(["-B", "docs/pictures/draw.py", "--check", "--era", ERA]);
    let output = run_command(&mut command);
    assert!(output.is_success(), "{}", output.error);
    let compared: BTreeSet<String> =
        output.out.lines().filter_map(|line| line.strip_suffix(UP_TO_DATE)).map(str::to_owned).collect();
    assert_eq!(compared, list_drawn_pictures(&root), "pictures that were compared, and pictures with the mark");
}
