//! Left for right, top for bottom, x for y, and lists in another order: the same answers at the places that correspond.

use crate::ask::{SAME, answers, same};
use crate::spec::{assert_holds_for_random_inputs, on, point, scenes, scenes_of};
use proptest::prelude::*;

/// Seen to fail with 5 % more moving mass in the left half.
#[test]
fn the_mirror_image_answers_mirrored() {
    assert_holds_for_random_inputs(14, (scenes(), point(), 0..2_usize), |(spec, at, axis)| {
        // A bar has its places on its axis.
        let axis = if spec.is_bar { 0 } else { axis };
        let at = on(&spec, at);
        let mirrored = spec.mirrored(axis);
        let mut there = at;
        there[axis] = spec.size_mm[axis] - at[axis];
        same("mirror", (&spec, &answers(&spec, at)?), (&mirrored, &answers(&mirrored, there)?), SAME)
    });
}

/// Seen to fail with 5 % more moving mass on one side of the diagonal.
#[test]
fn a_plate_with_x_and_y_exchanged_answers_the_same() {
    assert_holds_for_random_inputs(12, (scenes_of(false), point()), |(spec, at)| {
        let at = on(&spec, at);
        let turned = spec.transposed();
        same("transpose", (&spec, &answers(&spec, at)?), (&turned, &answers(&turned, [at[1], at[0]])?), SAME)
    });
}

/// Seen to fail with 5 % more moving mass for the first in the list.
#[test]
fn the_order_of_lists_is_of_no_account() {
    assert_holds_for_random_inputs(12, (scenes(), point()), |(spec, at)| {
        let at = on(&spec, at);
        let other = spec.reordered();
        same("order", (&spec, &answers(&spec, at)?), (&other, &answers(&other, at)?), SAME)?;
        // What a permutation must not do: the curves belong to their ERAs.
        prop_assert_eq!(&other.eras.last().unwrap().id, "era0");
        Ok(())
    });
}
