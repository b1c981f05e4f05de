//! Two scene files for one panel.

use super::ask::{SAME, answers, hold, same};
use super::spec::{Held, Mass, on, point, scenes, scenes_of};
use proptest::prelude::*;

/// Seen to fail with both halves left out, and with the damping of both doubled.
#[test]
fn two_half_supports_are_one() {
    let with_supports = scenes().prop_filter("needs a support", |spec| !spec.supports.is_empty());
    hold(6, (with_supports, point()), |(spec, at)| {
        let at = on(&spec, at);
        let mut split = spec.clone();
        let half = split.supports.last_mut().unwrap();
        half.stiffness *= 0.5;
        half.damping *= 0.5;
        let half = half.clone();
        split.supports.insert(0, half);
        same("halves", (&spec, &answers(&spec, at)?), (&split, &answers(&split, at)?), SAME)
    });
}

/// Seen to fail with a gram for it.
#[test]
fn a_mass_of_nothing_changes_nothing() {
    hold(10, (scenes(), point(), point()), |(spec, at, place)| {
        let at = on(&spec, at);
        let mut heavier = spec.clone();
        heavier.masses.push(Mass { at_mm: on(&spec, place), grams: 0.0 });
        same("no mass", (&spec, &answers(&spec, at)?), (&heavier, &answers(&heavier, at)?), SAME)
    });
}

/// A plate of which a strip at the right is cut away is a shorter plate. Seen to fail with a strip that leaves a millimetre more.
#[test]
fn a_strip_cut_off_makes_a_shorter_plate() {
    hold(10, (scenes_of(false), point(), 20.0..150.0_f64), |(mut short, at, strip)| {
        // What held the right edge went with the strip.
        short.edges[1] = Held::Free;
        let at = on(&short, at);
        let mut long = short.clone();
        let [length, width] = short.size_mm;
        long.size_mm[0] = length + strip;
        long.cutouts.push([length, 0.0, strip, width]);
        same("strip", (&short, &answers(&short, at)?), (&long, &answers(&long, at)?), SAME)
    });
}

/// A patch of the surface's own thickness is no patch, and one over all of another thickness is that surface. Seen to fail with a
/// patch 1 % thicker.
#[test]
fn a_patch_like_its_surface_is_none() {
    hold(8, (scenes(), point(), (0.05..0.4_f64, 0.5..0.95_f64), any::<bool>()), |(spec, at, (from, to), whole)| {
        let at = on(&spec, at);
        let mut patched = spec.clone();
        let [length, width] = spec.size_mm;
        if whole {
            patched.thickness_mm = 2.0 * spec.thickness_mm;
            patched.patches.push(([0.0, 0.0, length, width], spec.thickness_mm));
        } else {
            let (y, across) = if spec.is_bar { (0.0, width) } else { (from * width, (to - from) * width) };
            patched.patches.push(([from * length, y, (to - from) * length, across], spec.thickness_mm));
        }
        same("patch", (&spec, &answers(&spec, at)?), (&patched, &answers(&patched, at)?), SAME)
    });
}
