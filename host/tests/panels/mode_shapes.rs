//! Exported mode shapes against the closed form of a pinned plate, and what is written besides.
//!
//! A uniform plate pinned all round, a x b, of mass M: phi = 2 / sqrt(M) sin(m pi x / a) sin(n pi y / b), with the integral
//! of rho h phi_i phi_j over the surface 1 for i = j and 0 otherwise (Leissa, Vibration of Plates, 4.1).

use crate::support;
use std::f64::consts::PI;
use std::path::{Path, PathBuf};
use support::program::run_era;
use support::scenes::SceneText;

/// The scene's file, and the folder that it is in.
fn written(scene: &SceneText) -> (tempfile::TempDir, String) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.toml");
    std::fs::write(&path, scene.text()).unwrap();
    (folder, path.display().to_string())
}

/// Sides and numbers of an array of doubles: a reader of its own.
fn read_npy(path: &Path) -> (Vec<usize>, Vec<f64>) {
    let bytes = std::fs::read(path).unwrap();
    let end = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    let header = std::str::from_utf8(&bytes[10..end]).unwrap();
    assert!(header.contains("'<f8'") && header.contains("'fortran_order': False"), "{header}");
    let shape = header.split(['(', ')']).nth(1).unwrap();
    let sides = shape.split(',').filter_map(|side| side.trim().parse().ok()).collect();
    let numbers = bytes[end..].chunks_exact(8).map(|eight| f64::from_le_bytes(eight.try_into().unwrap()));
    (sides, numbers.collect())
}

struct Exported {
    sides: Vec<usize>,
    shapes: Vec<f64>,
    frequencies_hz: Vec<f64>,
    y_m: Vec<f64>,
    x_m: Vec<f64>,
}

impl Exported {
    fn of(scene: &SceneText, more: &[&str]) -> Self {
        let (folder, path) = written(scene);
        let file = folder.path().join("modes.npy");
        let output = run_era(&[&["modes", "--scene", &path, "--npy", file.to_str().unwrap()], more].concat());
        assert!(output.is_success(), "{}", output.error);
        let axis = |name: &str| read_npy(&folder.path().join(format!("modes.{name}.npy"))).1;
        let (sides, shapes) = read_npy(&file);
        Self { sides, shapes, frequencies_hz: axis("frequency_hz"), y_m: axis("y_m"), x_m: axis("x_m") }
    }

    fn mode(&self, mode: usize) -> &[f64] {
        let points = self.sides[1] * self.sides[2];
        &self.shapes[mode * points..(mode + 1) * points]
    }

    fn points(&self) -> impl Iterator<Item = (f64, f64)> {
        self.y_m.iter().flat_map(|y| self.x_m.iter().map(move |x| (*x, *y)))
    }

    /// Integral of mass per area times two functions: trapezoids, which are exact for sines of up to half as many waves as
    /// there are cells.
    fn product(&self, per_area: f64, a: &[f64], b: &[f64]) -> f64 {
        let weights = |axis: &[f64]| -> Vec<f64> {
            let last = axis.len() - 1;
            (0..=last).map(|i| 0.5 * (axis[(i + 1).min(last)] - axis[i.saturating_sub(1)])).collect()
        };
        let (wx, wy) = (weights(&self.x_m), weights(&self.y_m));
        let all = wy.iter().flat_map(|v| wx.iter().map(move |u| u * v));
        all.zip(a.iter().zip(b)).map(|(weight, (a, b))| per_area * weight * a * b).sum()
    }
}

fn sines(of: &Exported, plate: &SceneText, m: f64, n: f64) -> Vec<f64> {
    let scale = 2.0 / plate.surface_mass().sqrt();
    let at = |(x, y): (f64, f64)| scale * (m * PI * x / plate.length_m).sin() * (n * PI * y / plate.width_m).sin();
    of.points().map(at).collect()
}

/// Numbers of half-waves, by the frequency that goes with (m / a)^2 + (n / b)^2.
fn half_waves(plate: &SceneText, count: usize) -> Vec<(f64, f64)> {
    let square = |(m, n): &(f64, f64)| (m / plate.length_m).powi(2) + (n / plate.width_m).powi(2);
    let numbers = || (1..12).map(f64::from);
    let mut all: Vec<(f64, f64)> = numbers().flat_map(|m| numbers().map(move |n| (m, n))).collect();
    all.sort_by(|a, b| square(a).total_cmp(&square(b)));
    all.truncate(count);
    all
}

#[test]
fn shapes_of_a_pinned_plate_are_products_of_sines() {
    let plate = SceneText::plate(0.36, 0.24, 0.33).all_edges("pinned");
    let found = Exported::of(&plate, &["--max-hz", "1500", "--tolerance", "1e-6"]);
    let modes = found.frequencies_hz.len();
    assert!(modes >= 12 && found.sides == [modes, 33, 49], "{modes} {:?}", found.sides);
    let per_area = plate.surface_mass() / (plate.length_m * plate.width_m);
    for (k, (m, n)) in half_waves(&plate, modes).into_iter().enumerate() {
        let exact = sines(&found, &plate, m, n);
        // The convention: of the values that are as good as the largest the first is positive.
        let largest = exact.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
        let first = exact.iter().find(|value| value.abs() > largest * (1.0 - 1e-6)).unwrap();
        let worst = found.mode(k).iter().zip(&exact).map(|(a, b)| (a - first.signum() * b).abs()).fold(0.0, f64::max);
        assert!(worst < 1e-4 * largest, "mode {k}, {m} x {n} half-waves: {worst:e} of {largest}");
        for j in 0..=k {
            let product = found.product(per_area, found.mode(j), found.mode(k));
            let expected = if j == k { 1.0 } else { 0.0 };
            assert!((product - expected).abs() < 1e-4, "modes {j} and {k}: {product}");
        }
    }
}

/// Pairs of a square plate are some rotation of the sines: within their span, orthonormal, and by the convention one of
/// them vanishes where the other is largest.
#[test]
fn pairs_of_a_square_plate_follow_the_convention() {
    let plate = SceneText::plate(0.3, 0.3, 0.3).all_edges("pinned");
    let found = Exported::of(&plate, &["--max-hz", "700", "--tolerance", "1e-6", "--grid", "41,37"]);
    let per_area = plate.surface_mass() / (plate.length_m * plate.width_m);
    let (one, two) = (found.mode(1), found.mode(2));
    assert!((found.frequencies_hz[2] / found.frequencies_hz[1] - 1.0).abs() < 1e-7, "{:?}", found.frequencies_hz);
    let exact = [sines(&found, &plate, 1.0, 2.0), sines(&found, &plate, 2.0, 1.0)];
    for shape in [one, two] {
        let parts = [0, 1].map(|i| found.product(per_area, shape, &exact[i]));
        let inside = parts[0].powi(2) + parts[1].powi(2);
        assert!((inside - 1.0).abs() < 1e-4, "{parts:?}");
    }
    assert!(found.product(per_area, one, two).abs() < 1e-4);
    let together = |i: usize| exact[0][i].hypot(exact[1][i]);
    let largest = (0..one.len()).map(together).fold(0.0, f64::max);
    let at = (0..one.len()).find(|i| together(*i) > largest * (1.0 - 1e-6)).unwrap();
    assert!(
        (one[at] / largest - 1.0).abs() < 1e-4 && two[at].abs() < 1e-4 * largest,
        "{} {} {largest}",
        one[at],
        two[at]
    );
}

/// Sides of which no number of parts adds up to themselves: 0.36 * 48 / 48 is not 0.36.
#[test]
fn axes_end_exactly_at_the_edges() {
    for (length, width, grid) in [(0.36, 0.24, "49,33"), (0.37, 0.247, "50,7"), (0.123, 0.38, "3,48")] {
        let plate = SceneText::plate(length, width, 0.33).corner_springs(2e3);
        let found = Exported::of(&plate, &["--max-hz", "300", "--accuracy", "fast", "--grid", grid]);
        let ends = |axis: &[f64]| (axis[0], axis[axis.len() - 1]);
        let sides = |text: &str| text.parse::<f64>().unwrap() / 1e3;
        let expected = [length, width].map(|side| sides(&format!("{:?}", side * 1e3)));
        assert_eq!([ends(&found.x_m), ends(&found.y_m)], expected.map(|side| (0.0, side)), "{grid}");
    }
}

#[test]
fn a_bar_has_one_row_and_a_cut_out_has_no_value() {
    let bar = Exported::of(&SceneText::bar(0.3).edge("left", "clamped"), &["--max-hz", "1000", "--grid", "31,9"]);
    assert_eq!(bar.sides[1..], [1, 31]);
    // A cantilever's largest value is at its free end, 2 / sqrt(M).
    let tip = 2.0 / SceneText::bar(0.3).surface_mass().sqrt();
    assert!(bar.frequencies_hz.len() >= 2);
    for k in 0..bar.frequencies_hz.len() {
        let mode = bar.mode(k);
        assert!((mode[30] / tip - 1.0).abs() < 1e-3 && mode[0].abs() < 1e-9 * tip, "{k}: {mode:?}");
    }
    let (folder, _) = written(&SceneText::bar(0.3));
    let scene = format!(
        "{}[[cutout]]\nx_mm = 100.0\ny_mm = 80.0\nlength_mm = 100.0\nwidth_mm = 40.0\n",
        SceneText::plate(0.3, 0.2, 0.33).corner_springs(2e3).text()
    );
    let (path, csv) = (folder.path().join("hole.toml"), folder.path().join("hole.csv"));
    std::fs::write(&path, scene).unwrap();
    let png = folder.path().join("hole.png");
    let names = [&path, &csv, &png].map(|path| path.to_str().unwrap().to_owned());
    let output = run_era(&[
        "modes",
        "--scene",
        &names[0],
        "--max-hz",
        "200",
        "--accuracy",
        "fast",
        "--grid",
        "7,5",
        "--csv",
        &names[1],
        "--png",
        &names[2],
    ]);
    assert!(output.is_success(), "{}", output.error);
    let text = std::fs::read_to_string(&csv).unwrap();
    let mut lines = text.lines();
    assert_eq!(lines.next().unwrap(), "mode,frequency_hz,error_bound,x_mm,y_mm,shape_per_sqrt_kg");
    let lines: Vec<Vec<&str>> = lines.map(|line| line.split(',').collect()).collect();
    let modes = lines.last().unwrap()[0].parse::<usize>().unwrap();
    assert_eq!(lines.len(), modes * 35);
    // Only the middle point of 7 x 5 is inside.
    for line in &lines {
        let inside = (line[3], line[4]) == ("150.000000", "100.000000");
        assert_eq!(line[5].is_empty(), inside, "{line:?}");
    }
    assert_picture(&png, modes);
}

/// A sheet with as many maps as modes: columns of the picture that are not white, side by side.
fn assert_picture(path: &PathBuf, modes: usize) {
    let picture = image::open(path).unwrap().to_rgb8();
    assert!(picture.width() > 300 && picture.height() > 200, "{:?}", picture.dimensions());
    let colored = |row: u32| {
        let is_colored = |x: u32| {
            let [r, g, b] = picture.get_pixel(x, row).0;
            r.abs_diff(b) > 40 || r.abs_diff(g) > 40
        };
        // Runs of colour longer than a tick, at gaps wider than the hole of a node line.
        let (mut runs, mut last) = (0_usize, None::<u32>);
        for x in (0..picture.width()).filter(|x| is_colored(*x)) {
            if last.is_none_or(|last| x - last > 70) {
                runs += 1;
            }
            last = Some(x);
        }
        runs
    };
    let most = (0..picture.height()).map(colored).max().unwrap();
    // A hole may part each map in two; the scale beside the last map of the first row is one more run at most.
    assert!(most >= modes.min(4) && most <= 2 * modes.min(4) + 1, "{most} of {modes}");
}

#[test]
fn names_that_do_not_fit_are_refused_before_anything_is_computed() {
    for (arguments, words) in [
        (["--npy", "modes.txt"], "end in .npy"),
        (["--png", "modes.jpg"], "end in .png"),
        (["--grid", "0,5"], "1 to 10000"),
    ] {
        let output = run_era(&[&["modes"], &arguments[..]].concat());
        let told = &output.error;
        assert!(output.code == Some(2) && told.contains(words), "{told}");
    }
    let output = run_era(&["modes", "--max-hz", "300", "--accuracy", "fast", "--grid", "9999,9999", "--csv", "-"]);
    let told = &output.error;
    assert!(output.code == Some(2) && told.contains("--grid") && told.contains("allowed"), "{told}");
}
