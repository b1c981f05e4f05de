//! The manual's links and pictures: what a page names exists, every picture is on a page, and the pictures that
//! `docs/pictures/draw.py` makes from the sources are those of the present sources.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Component, Path, PathBuf};
use std::process::Command;

/// Largest file of a drawn picture in bytes.
const MOST_BYTES: usize = 60_000;
/// The mark of `docs/pictures/canvas.py` in each picture.
const DRAWN: &str = "drawn by docs/pictures/draw.py";

/// A page in Markdown.
struct Page {
    /// Path from the repository's root.
    path: PathBuf,
    /// Targets of its links and images, in order.
    links: Vec<String>,
    /// Fragments that its headings have.
    anchors: BTreeSet<String>,
    /// Files of the sources that it names outside of code blocks.
    sources: Vec<String>,
}

fn find_root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(2).expect("a repository").to_path_buf()
}

/// The pages of the manual, and those of the root, by their paths.
fn read_pages(root: &Path) -> BTreeMap<PathBuf, Page> {
    let mut pages = BTreeMap::new();
    for folder in ["", "docs/src"] {
        for entry in fs::read_dir(root.join(folder)).expect("a folder").flatten() {
            let path = Path::new(folder).join(entry.file_name());
            if path.extension().is_some_and(|extension| extension == "md") {
                let text = fs::read_to_string(root.join(&path)).expect("a page");
                pages.insert(path.clone(), parse_page(path, &text));
            }
        }
    }
    pages
}

fn parse_page(path: PathBuf, text: &str) -> Page {
    let (mut links, mut anchors) = (Vec::new(), BTreeSet::new());
    let mut is_code = false;
    let mut prose = String::new();
    for line in text.lines() {
        if line.trim_start().starts_with("```") {
            is_code = !is_code;
        } else if !is_code {
            prose.push_str(line);
            prose.push('\n');
            let heading = line.trim_start_matches('#');
            if heading.len() < line.len() && heading.starts_with(' ') {
                anchors.insert(anchor_of(heading));
            }
        }
    }
    for (start, _) in prose.match_indices("](") {
        if let Some((target, _)) = prose.get(start + 2..).and_then(|rest| rest.split_once(')')) {
            links.push(target.trim().to_owned());
        }
    }
    let marked = prose.split('`').skip(1).step_by(2);
    let sources = marked.filter(|word| is_name_of_source_file(word)).map(str::to_owned).collect();
    Page { path, links, anchors, sources }
}

/// Whether a word between backticks is a name of a source file, with or without folders.
fn is_name_of_source_file(word: &str) -> bool {
    let is_of_path = |letter: char| letter.is_ascii_alphanumeric() || "_-./".contains(letter);
    [".rs", ".py", ".js", ".x"].iter().any(|end| word.ends_with(end)) && word.chars().all(is_of_path)
}

/// The fragment that mdbook gives a heading: the target of a link in it does not count.
fn anchor_of(heading: &str) -> String {
    let mut shown = String::new();
    let mut rest = heading.trim();
    while let Some((before, after)) = rest.split_once("](") {
        shown.push_str(before);
        rest = after.split_once(')').map_or("", |(_, rest)| rest);
    }
    shown.push_str(rest);
    shown
        .chars()
        .filter_map(|letter| match letter {
            ' ' => Some('-'),
            '-' | '_' => Some(letter),
            _ if letter.is_alphanumeric() => Some(letter.to_ascii_lowercase()),
            _ => None,
        })
        .collect()
}

/// The path of `target`, which the page `from` names, from the repository's root.
fn resolve(from: &Path, target: &str) -> PathBuf {
    let mut path = PathBuf::new();
    for component in from.parent().unwrap_or(Path::new("")).join(target).components() {
        match component {
            Component::ParentDir => {
                path.pop();
            }
            Component::Normal(name) => path.push(name),
            _ => {}
        }
    }
    path
}

/// What each page names inside of the repository: the page, the target as written, its path and its fragment.
fn list_targets(pages: &BTreeMap<PathBuf, Page>) -> Vec<(&Path, &str, PathBuf, &str)> {
    let mut targets = Vec::new();
    for page in pages.values() {
        for link in page.links.iter().filter(|link| !link.contains("://") && !link.starts_with("mailto:")) {
            let (file, anchor) = link.split_once('#').unwrap_or((link, ""));
            let path = if file.is_empty() { page.path.clone() } else { resolve(&page.path, file) };
            targets.push((page.path.as_path(), link.as_str(), path, anchor));
        }
    }
    targets
}

/// Everything that a page names and that does not exist.
fn find_broken(root: &Path, pages: &BTreeMap<PathBuf, Page>) -> Vec<String> {
    let mut broken = Vec::new();
    for (from, link, path, anchor) in list_targets(pages) {
        if let Some(page) = pages.get(&path) {
            if !anchor.is_empty() && !page.anchors.contains(anchor) {
                broken.push(format!("{}: no heading has the fragment of {link}", from.display()));
            }
        } else if !root.join(&path).exists() {
            broken.push(format!("{}: there is no {link}", from.display()));
        }
    }
    broken
}

/// Names of the pictures of the manual.
fn list_pictures(root: &Path) -> Vec<String> {
    let entries = fs::read_dir(root.join("docs/src/images")).expect("pictures").flatten();
    entries.filter_map(|entry| entry.file_name().into_string().ok()).collect()
}

#[test]
fn every_link_leads_somewhere() {
    let root = find_root();
    let broken = find_broken(&root, &read_pages(&root));
    assert!(broken.is_empty(), "{}", broken.join("\n"));
}

/// What is wrong with the lines of a page, each with its number: a row of a table that goes on in the next line is no row, and the manual's
/// lines have at most 120 characters, but for rows and pictures.
fn find_layout_mistakes(text: &str) -> Vec<String> {
    let (mut is_code, mut is_after_row, mut found) = (false, false, Vec::new());
    for (number, line) in (1..).zip(text.lines()) {
        let trimmed = line.trim();
        if trimmed.starts_with("```") {
            is_code = !is_code;
        }
        let is_row = !is_code && trimmed.starts_with('|');
        if is_row && !trimmed.ends_with('|') {
            found.push(format!("{number}: a row that does not end"));
        }
        if is_after_row && !is_row && !trimmed.is_empty() {
            found.push(format!("{number}: text directly below a table"));
        }
        if !is_code && !is_row && line.chars().count() > 120 && !trimmed.starts_with("![") {
            found.push(format!("{number}: {} characters", line.chars().count()));
        }
        is_after_row = is_row;
    }
    found
}

#[test]
fn the_lines_of_the_manual_are_short_and_its_tables_whole() {
    let root = find_root();
    let mut mistakes = Vec::new();
    for path in read_pages(&root).into_keys().filter(|path| path.starts_with("docs/src")) {
        let text = fs::read_to_string(root.join(&path)).expect("a page");
        mistakes.extend(find_layout_mistakes(&text).into_iter().map(|mistake| format!("{}:{mistake}", path.display())));
    }
    assert!(mistakes.is_empty(), "{}", mistakes.join("\n"));
    let wrong = "| a | b |\n|---|---|\n| 1 | two\nlines |\n\n".to_owned() + &"x".repeat(121);
    assert_eq!(find_layout_mistakes(&wrong).len(), 3, "{:?}", find_layout_mistakes(&wrong));
}

#[test]
fn every_page_is_in_the_summary() {
    let root = find_root();
    let summary = fs::read_to_string(root.join("docs/src/SUMMARY.md")).expect("a summary");
    let is_listed = |path: &PathBuf| {
        let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        name == "SUMMARY.md" || summary.contains(&format!("]({name})"))
    };
    let left_out: Vec<PathBuf> =
        read_pages(&root).into_keys().filter(|path| path.starts_with("docs/src") && !is_listed(path)).collect();
    assert!(left_out.is_empty(), "{left_out:?}");
}

/// A file that has been renamed or removed would still be described.
#[test]
fn every_source_file_that_a_page_names_exists() {
    let root = find_root();
    let output = Command::new("git").current_dir(&root).args(["ls-files", "-z"]).output().expect("git");
    let tracked = String::from_utf8(output.stdout).expect("names");
    let tracked: Vec<String> = tracked.split('\0').map(|file| format!("/{file}")).collect();
    // The guide has the reader write this one; the changelog names files that were removed later.
    let is_checked = |page: &&Page| page.path != Path::new("CHANGELOG.md");
    let pages = read_pages(&root);
    let named =
        || pages.values().filter(is_checked).flat_map(|page| page.sources.iter().map(move |file| (&page.path, file)));
    let missing: Vec<String> = named()
        .filter(|(_, file)| *file != "client.py" && !tracked.iter().any(|path| path.ends_with(&format!("/{file}"))))
        .map(|(page, file)| format!("{}: there is no {file}", page.display()))
        .collect();
    assert!(missing.is_empty(), "{}", missing.join("\n"));
    assert!(named().count() > 200, "the pages name {} source files", named().count());
}

#[test]
fn a_link_that_leads_nowhere_is_named() {
    let root = find_root();
    let text = "\
# A [title](x.md) of `three` words, and one
![a picture](images/no-such.png) and [a page](safety.md), [a
part](safety.md#limits), [another](safety.md#no-such-part), [this](#a-title-of-three-words-and-one), [the web](https://example.org/x)
```text
[code](no-such.md)
```
[outside](../../README.md), [nowhere](../../no-such.md)
";
    let mut pages = read_pages(&root);
    let path = PathBuf::from("docs/src/invented.md");
    pages.insert(path.clone(), parse_page(path, text));
    let broken = find_broken(&root, &pages);
    let invented: Vec<&String> = broken.iter().filter(|line| line.starts_with("docs/src/invented.md")).collect();
    let expected = ["no x.md", "no images/no-such.png", "fragment of safety.md#no-such-part", "no ../../no-such.md"];
    assert_eq!(invented.len(), expected.len(), "{invented:#?}");
    for (line, part) in invented.iter().zip(expected) {
        assert!(line.ends_with(part), "{line} is not about {part}");
    }
}

#[test]
fn every_picture_is_on_a_page() {
    let root = find_root();
    let pages = read_pages(&root);
    let named: BTreeSet<PathBuf> = list_targets(&pages).into_iter().map(|(_, _, path, _)| path).collect();
    let pictures = list_pictures(&root);
    assert!(!pictures.is_empty());
    let unused: Vec<&String> =
        pictures.iter().filter(|name| !named.contains(&Path::new("docs/src/images").join(name))).collect();
    assert!(unused.is_empty(), "no page has the pictures {unused:?} of docs/src/images");
}

#[test]
fn drawn_pictures_are_small_and_say_what_they_show() {
    let root = find_root();
    let mut drawn = 0;
    for name in list_pictures(&root).iter().filter(|name| name.ends_with(".svg")) {
        let text = fs::read_to_string(root.join("docs/src/images").join(name)).expect("a picture");
        if text.contains(DRAWN) {
            drawn += 1;
            assert!(text.len() <= MOST_BYTES, "{name} has {} bytes, more than {MOST_BYTES}", text.len());
            for element in ["<title", "<desc"] {
                assert!(text.contains(element), "{name} has no {element}>");
            }
        }
    }
    assert!(drawn >= 10, "only {drawn} pictures are marked as {DRAWN}");
}

#[test]
fn pictures_made_from_the_sources_are_up_to_date() {
    let root = find_root();
    // -B: no compiled files beside the script.
    let output = Command::new("python3")
        .current_dir(&root)
        .args(["-B", "docs/pictures/draw.py", "--check"])
        .output()
        .expect("python3");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}
