//! Integrals over the cells that a singular function reaches: with the elements' functions and among themselves.
//!
//! Each cell is cut into rectangles that are small against their distance to every singular point (a factor of four from
//! one to the next, where Gauss points converge as 9^-n), and on each rectangle the tensor structure of the elements'
//! functions is used: along x first, then along y.

use super::grid::Grid;
use super::mesh::GridLines;
use super::sections::{CellSection, RelativeBending};
use super::shape::gauss_legendre_rule_on_unit_interval;
use super::singular::{FunctionJet, SingularFunction};
use super::sparse::MatrixEntries;
use crate::kernel;
use pulp::Arch;

/// Rectangles touching a singular point are cut until they are this part of the cell, or of the distance of two places whose
/// functions' difference quotient is a function: frequencies are then right to 1e-11 even
/// on rigid points inside a plate, 20 times less than their other rounding (cut to a millionth, they change no more).
const SMALLEST: f64 = 1.0 / 4096.0;
/// Largest side of a rectangle over its distance to the singular point: 3 for three quarters of a side cut at a quarter.
const NEAREST: f64 = 3.01;
/// Gauss points beyond the elements' order: for the blending polynomials (degree 7) and the logarithm.
const EXTRA_POINTS: usize = 6;

/// Fewer points on smaller rectangles: an energy of 16^-l needs that many digits less after l cuts, log 16 / (2 log 3) = 1.26
/// points each. A difference quotient has as much energy in every ring down to the distance of its places: cuts count from
/// there.
const FEWER_POINTS: f64 = 1.2;
/// Digits that Gauss points have to bring on parts that are far from singular points for their size.
const DIGITS: f64 = 13.0;
/// Least points.
const LEAST_POINTS: usize = 4;

/// A rectangle: x from, x to, y from, y to.
type Rectangle = [f64; 4];

/// A cell that singular functions reach, cut up for integration.
struct EnrichedCell<'a> {
    /// Along x and along y.
    at: [usize; 2],
    bounds: Rectangle,
    section: CellSection,
    /// The functions, with their unknowns.
    active: Vec<(usize, &'a SingularFunction)>,
    parts: Vec<QuadratureRectangle>,
}

/// All cells that singular functions reach, cut up for integration.
fn cells_reached_by_singular_functions_cut_for_integration<'a>(
    grid: &'a Grid,
    y: &'a GridLines,
) -> impl Iterator<Item = EnrichedCell<'a>> {
    let cells = (0..y.count_cells()).flat_map(|cell_y| (0..grid.x.count_cells()).map(move |cell_x| [cell_x, cell_y]));
    cells.filter_map(|at| {
        let [cell_x, cell_y] = at;
        let bounds = [grid.x.at[cell_x], grid.x.at[cell_x + 1], y.at[cell_y], y.at[cell_y + 1]];
        let active: Vec<(usize, &SingularFunction)> =
            grid.unknowns_and_singular_functions_reaching_into_rectangle(bounds).collect();
        let section = grid.sections.section_of_cell_unless_cut_away(cell_x, cell_y).filter(|_| !active.is_empty())?;
        let parts = cut_cell_into_rectangles(
            bounds,
            &collect_singular_and_blending_centres(&active),
            &collect_function_ends_along_x_and_y(&active),
            longer_side(bounds),
        );
        Some(EnrichedCell { at, bounds, section, active, parts })
    })
}

/// The integral of every singular function of `grid` over the surface that is there in m^2 (functions have no unit), with its number.
pub(super) fn unknowns_and_area_integrals_of_singular_functions_per_cell(
    grid: &Grid,
    y: &GridLines,
) -> Vec<(usize, f64)> {
    let rules = GaussRules::new(grid.element.element_order() + 1 + EXTRA_POINTS);
    let mut integrals = Vec::new();
    for EnrichedCell { bounds, active, parts, .. } in cells_reached_by_singular_functions_cut_for_integration(grid, y) {
        for (number, f) in active {
            let over_part = |part: &QuadratureRectangle| {
                let (rule, [left, right, top, bottom]) =
                    (rules.choose_gauss_rule_for_rectangle(part, bounds), part.bounds);
                let row = |y_m: f64| -> f64 {
                    rule.iter()
                        .map(|(at, weight)| weight * f.evaluate_jet_at(left + at * (right - left), y_m).value)
                        .sum()
                };
                let sum: f64 = rule.iter().map(|(at, weight)| weight * row(top + at * (bottom - top))).sum();
                sum * (right - left) * (bottom - top)
            };
            integrals.push((number, parts.iter().map(over_part).sum()));
        }
    }
    integrals
}

/// Adds the surface's stiffness and mass that the singular functions of `grid` bring.
pub(super) fn add_singular_function_matrices(
    grid: &Grid,
    y: &GridLines,
    stiffness: &mut MatrixEntries,
    mass: &mut MatrixEntries,
) {
    let n = grid.element.element_order() + 1;
    let rules = GaussRules::new(n + EXTRA_POINTS);
    for EnrichedCell { at: [cell_x, cell_y], bounds, section, active, parts } in
        cells_reached_by_singular_functions_cut_for_integration(grid, y)
    {
        let mut block = EnrichedCellIntegrals::new(n, active.len());
        for part in parts {
            let rule = rules.choose_gauss_rule_for_rectangle(&part, bounds);
            let part = part.bounds;
            let x = DirectionQuadrature::new(grid, &grid.x, cell_x, [part[0], part[1]], rule);
            let y = DirectionQuadrature::new(grid, y, cell_y, [part[2], part[3]], rule);
            block.add_integrals_over_rectangle(&x, &y, &active, section.bending);
        }
        let numbers: Vec<_> = (0..n * n)
            .map(|k| {
                grid.unknown_of_function_product_unless_fixed(
                    grid.function_index_along_one_axis(cell_x, k / n),
                    grid.function_index_along_one_axis(cell_y, k % n),
                )
            })
            .collect();
        for (e, (number, _)) in active.iter().enumerate() {
            for (k, other) in numbers.iter().enumerate() {
                if let Some(other) = other {
                    let [bend, inertia] = block.with_cell[e * n * n + k];
                    add_value_at_entry_and_transpose(stiffness, *number, *other, section.rigidity * bend);
                    add_value_at_entry_and_transpose(mass, *number, *other, section.per_area * inertia);
                }
            }
            for (f, (other, _)) in active.iter().enumerate() {
                let [bend, inertia] = block.bending_and_inertia_integrals_of_pair(e, f);
                stiffness.add_entry_without_its_transpose(*number, *other, section.rigidity * bend);
                mass.add_entry_without_its_transpose(*number, *other, section.per_area * inertia);
            }
        }
    }
}

/// Adds a value at (row, column) and at (column, row).
fn add_value_at_entry_and_transpose(entries: &mut MatrixEntries, row: usize, column: usize, value: f64) {
    entries.add_entry_without_its_transpose(row, column, value);
    entries.add_entry_without_its_transpose(column, row, value);
}

/// The longer side of a rectangle.
fn longer_side(rectangle: Rectangle) -> f64 {
    (rectangle[1] - rectangle[0]).max(rectangle[3] - rectangle[2])
}

/// Gauss rules by the number of their points.
struct GaussRules(Vec<Vec<(f64, f64)>>);

impl GaussRules {
    fn new(most: usize) -> Self {
        Self(
            (0..=most)
                .map(
                    |points| {
                        if points < LEAST_POINTS { Vec::new() } else { gauss_legendre_rule_on_unit_interval(points) }
                    },
                )
                .collect(),
        )
    }

    /// The Gauss rule that integrates a part of a cell to the digits that count.
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        clippy::cast_precision_loss,
        reason = "small counts, and `as` saturates"
    )]
    fn choose_gauss_rule_for_rectangle(&self, part: &QuadratureRectangle, cell: Rectangle) -> &[(f64, f64)] {
        let own = longer_side(part.bounds);
        let cuts = (part.cut_from / own).log(4.0).max(0.0);
        let most = self.0.len() - 1;
        let cut = most as f64 - FEWER_POINTS * cuts;
        // Gauss points converge as rho^-2n, rho the half axes' sum of the ellipse about the part through the nearest singular
        // point (and no larger than the cell, beyond which the elements' polynomials grow; along either side, as a part
        // of a thin cell may be all of its width).
        let apart = 1.0 + 2.0 * part.distance / own;
        let of_cell = |from: usize| (cell[from + 1] - cell[from]) / (part.bounds[from + 1] - part.bounds[from]);
        let rho = (apart + (apart * apart - 1.0).sqrt()).min(1.5 * of_cell(0).min(of_cell(2)));
        let enough = if rho > 1.0 { DIGITS * std::f64::consts::LN_10 / (2.0 * rho.ln()) + 1.0 } else { f64::INFINITY };
        let points = cut.min(enough).round() as usize;
        &self.0[points.clamp(LEAST_POINTS.min(most), most)]
    }
}

/// Integrals of one cell, each [bending over rigidity, inertia over mass per area].
struct EnrichedCellIntegrals {
    n: usize,
    with_cell: Vec<[f64; 2]>,
    /// Bending, and inertia: functions x functions, of which one half is summed.
    among: [Vec<f64>; 2],
}

/// Points and weights of one rectangle in one direction, with the cell's functions there.
struct DirectionQuadrature {
    at: Vec<f64>,
    weight: Vec<f64>,
    /// Value, first and second derivative, points x functions.
    functions: Vec<[Vec<f64>; 3]>,
}

impl DirectionQuadrature {
    fn new(grid: &Grid, lines: &GridLines, cell: usize, part: [f64; 2], rule: &[(f64, f64)]) -> Self {
        let (from, width) = (lines.at[cell], lines.at[cell + 1] - lines.at[cell]);
        let scale = [lines.scale[cell], lines.scale[cell + 1]];
        let (length, element) =
            (part[1] - part[0], grid.choose_element_with_rigid_body_functions_for_strip_else_ordinary(lines));
        let at: Vec<f64> = rule.iter().map(|(t, _)| part[0] + t * length).collect();
        Self {
            functions: at
                .iter()
                .map(|at| element.values_and_derivatives_at((at - from) / width, width, scale))
                .collect(),
            weight: rule.iter().map(|(_, weight)| weight * length).collect(),
            at,
        }
    }
}

/// Jets of all functions at one point, kind by kind.
struct Jets {
    value: Vec<f64>,
    xx: Vec<f64>,
    yy: Vec<f64>,
    xy: Vec<f64>,
}

impl EnrichedCellIntegrals {
    fn new(n: usize, singular: usize) -> Self {
        Self { n, with_cell: vec![[0.0; 2]; singular * n * n], among: [0; 2].map(|_| vec![0.0; singular * singular]) }
    }

    /// The integrals of two singular functions: bending over rigidity, inertia over mass per area.
    fn bending_and_inertia_integrals_of_pair(&self, first_function: usize, second_function: usize) -> [f64; 2] {
        let count = self.among[0].len().isqrt();
        // Only one half is summed.
        let at = first_function.max(second_function) * count + first_function.min(second_function);
        [self.among[0][at], self.among[1][at]]
    }

    fn add_integrals_over_rectangle(
        &mut self,
        x: &DirectionQuadrature,
        y: &DirectionQuadrature,
        active: &[(usize, &SingularFunction)],
        bending: RelativeBending,
    ) {
        let (n, count) = (self.n, active.len());
        let zeros = || vec![0.0; count];
        let mut jets = Jets { value: zeros(), xx: zeros(), yy: zeros(), xy: zeros() };
        // Sums along x for each function a: against N_a'', N_a (bending), N_a' and N_a (inertia).
        let mut along_x = vec![[0.0; 4]; count * n];
        for (at_y, (y_m, weight_y)) in y.at.iter().zip(&y.weight).enumerate() {
            along_x.fill([0.0; 4]);
            for (at_x, (x_m, weight_x)) in x.at.iter().zip(&x.weight).enumerate() {
                let weight = weight_x * weight_y;
                let [value, first, second] = &x.functions[at_x];
                for (e, (_, f)) in active.iter().enumerate() {
                    let FunctionJet { value: own, xx, yy, xy, .. } = f.evaluate_jet_at(*x_m, *y_m);
                    (jets.value[e], jets.xx[e], jets.yy[e], jets.xy[e]) = (own, xx, yy, xy);
                    let [bend_x, bend_y, twist] = bending
                        .relative_bending_moments_and_twice_twisting_moment(xx, yy, xy)
                        .map(|moment| weight * moment);
                    let inertia = weight * own;
                    for (a, sum) in along_x[e * n..(e + 1) * n].iter_mut().enumerate() {
                        sum[0] += second[a] * bend_x;
                        sum[1] += value[a] * bend_y;
                        sum[2] += first[a] * twist;
                        sum[3] += value[a] * inertia;
                    }
                }
                Arch::new().dispatch(AddAmong(&jets, weight, bending, &mut self.among));
            }
            let [value, first, second] = &y.functions[at_y];
            for (sum, out) in along_x.iter().zip(self.with_cell.chunks_exact_mut(n)) {
                for (b, out) in out.iter_mut().enumerate() {
                    out[0] += sum[0] * value[b] + sum[1] * second[b] + sum[2] * first[b];
                    out[1] += sum[3] * value[b];
                }
            }
        }
    }
}

kernel!(AddAmong<'a>(jets: &'a Jets, weight: f64, bending: RelativeBending, sums: &'a mut [Vec<f64>; 2]) -> () = add_pair_integrals_at_point);

/// Adds a point to the lower half of the functions' integrals among themselves: with hundreds of functions' rectangles times
/// their squared number, most of the work.
#[inline(always)]
fn add_pair_integrals_at_point(
    jets: &Jets,
    weight: f64,
    bending: RelativeBending,
    [bend, inertia]: &mut [Vec<f64>; 2],
) {
    let count = jets.value.len();
    for e in 0..count {
        let moments = bending.relative_bending_moments_and_twice_twisting_moment(jets.xx[e], jets.yy[e], jets.xy[e]);
        let [along_x, along_y, twist] = moments.map(|moment| weight * moment);
        let own = weight * jets.value[e];
        let (row, others) = (e * count..e * count + e + 1, ..=e);
        let curvatures = jets.xx[others].iter().zip(&jets.yy[others]).zip(&jets.xy[others]);
        for (out, ((xx, yy), xy)) in bend[row.clone()].iter_mut().zip(curvatures) {
            *out += along_x * xx + along_y * yy + twist * xy;
        }
        inertia[row].iter_mut().zip(&jets.value[others]).for_each(|(out, value)| *out += own * value);
    }
}

/// A place where functions are singular, or where their blending has its joints.
#[derive(Clone, Copy, Debug)]
struct SingularCentre {
    at: (f64, f64),
    /// The least distance that a function about it varies over, other than towards it; infinite if there is none.
    finest: f64,
}

/// All places where functions are singular or their blending has joints, each once.
fn collect_singular_and_blending_centres(active: &[(usize, &SingularFunction)]) -> Vec<SingularCentre> {
    let of = |f: &SingularFunction| {
        let sources = f.sources.iter().map(|source| SingularCentre { at: source.centre, finest: f.finest });
        sources.chain([SingularCentre { at: (f.x.centre, f.y.centre), finest: f64::INFINITY }]).collect::<Vec<_>>()
    };
    let mut all: Vec<SingularCentre> = active.iter().flat_map(|(_, f)| of(f)).collect();
    all.sort_by(|a, b| a.at.0.total_cmp(&b.at.0).then(a.at.1.total_cmp(&b.at.1)).then(a.finest.total_cmp(&b.finest)));
    // The finest of each place comes first, and stays.
    all.dedup_by(|b, a| a.at == b.at);
    all
}

/// Where functions end along x and along y. That is on lines of the mesh, unless cells shrink towards an attachment beside a patch:
/// its own lines move those between. The second derivative jumps there.
fn collect_function_ends_along_x_and_y(active: &[(usize, &SingularFunction)]) -> [Vec<f64>; 2] {
    let along = |reach: &dyn Fn(&SingularFunction) -> [f64; 2]| active.iter().flat_map(|(_, f)| reach(f)).collect();
    [along(&|f| [f.x.from, f.x.to]), along(&|f| [f.y.from, f.y.to])]
}

/// A part of a rectangle.
#[derive(Clone, Copy, Debug)]
struct QuadratureRectangle {
    bounds: Rectangle,
    /// Distance of the nearest centre.
    distance: f64,
    /// From this size on less counts towards that centre: the cell's, or of what varies finer there.
    cut_from: f64,
}

/// The rectangle cut up for integration. All centres' coordinates become borders, as the blending has its joints there, and all `ends`
/// along x and along y.
fn cut_cell_into_rectangles(
    bounds: Rectangle,
    centres: &[SingularCentre],
    ends: &[Vec<f64>; 2],
    longer_cell_side_m: f64,
) -> Vec<QuadratureRectangle> {
    let finest = centres.iter().map(|centre| centre.finest).fold(longer_cell_side_m, f64::min);
    let stops = |from: f64, to: f64, at: &dyn Fn(&SingularCentre) -> f64, ends: &[f64]| {
        if from >= to {
            // A stretch of a line.
            return vec![from, to];
        }
        let mut stops: Vec<f64> = centres.iter().map(at).filter(|at| *at > from && *at < to).collect();
        // On a line of the mesh, but for rounding, it is that line.
        let hair = SMALLEST * finest;
        stops.extend(ends.iter().copied().filter(|end| *end > from + hair && *end < to - hair));
        stops.extend([from, to]);
        stops.sort_by(f64::total_cmp);
        stops.dedup_by(|b, a| *b - *a < SMALLEST * finest);
        stops
    };
    let in_x = stops(bounds[0], bounds[1], &|c| c.at.0, &ends[0]);
    let in_y = stops(bounds[2], bounds[3], &|c| c.at.1, &ends[1]);
    let mut out = Vec::new();
    for y in in_y.windows(2) {
        for x in in_x.windows(2) {
            cut_towards_singular_centres([x[0], x[1], y[0], y[1]], centres, longer_cell_side_m, &mut out);
        }
    }
    out
}

/// Cuts a rectangle into parts that are small against their distance to every singular centre.
fn cut_towards_singular_centres(
    part: Rectangle,
    centres: &[SingularCentre],
    longer_cell_side_m: f64,
    parts: &mut Vec<QuadratureRectangle>,
) {
    let (width, height) = (part[1] - part[0], part[3] - part[2]);
    let largest = width.max(height);
    let beside = |from: f64, to: f64, at: f64| (from - at).max(at - to).max(0.0);
    let away = |centre: &SingularCentre| {
        let (x, y) = centre.at;
        beside(part[0], part[1], x).hypot(beside(part[2], part[3], y))
    };
    // The one that asks for the smallest parts, of those that ask for smaller ones than this.
    let is_large = |centre: &(f64, &SingularCentre)| {
        largest > NEAREST * centre.0 && largest > SMALLEST * longer_cell_side_m.min(centre.1.finest)
    };
    let all = centres.iter().map(|centre| (away(centre), centre));
    let nearest = |a: &(f64, &SingularCentre), b: &(f64, &SingularCentre)| a.0.total_cmp(&b.0);
    let Some((_, centre)) = all.clone().filter(is_large).min_by(nearest) else {
        let (distance, finest) =
            all.min_by(nearest).map_or((f64::INFINITY, f64::INFINITY), |(distance, centre)| (distance, centre.finest));
        return parts.push(QuadratureRectangle { bounds: part, distance, cut_from: longer_cell_side_m.min(finest) });
    };
    let (x, y) = centre.at;
    // At a quarter from the end that is nearer to the point; a long rectangle is first cut across.
    let place = |from: f64, to: f64, at: f64| {
        if at - from <= to - at { 0.75 * from + 0.25 * to } else { 0.25 * from + 0.75 * to }
    };
    let (at_x, at_y) = (place(part[0], part[1], x), place(part[2], part[3], y));
    let in_x = if 2.0 * width > height { vec![[part[0], at_x], [at_x, part[1]]] } else { vec![[part[0], part[1]]] };
    let in_y = if 2.0 * height > width { vec![[part[2], at_y], [at_y, part[3]]] } else { vec![[part[2], part[3]]] };
    for [y0, y1] in in_y {
        for [x0, x1] in &in_x {
            cut_towards_singular_centres([*x0, *x1, y0, y1], centres, longer_cell_side_m, parts);
        }
    }
}

/// Adds what line springs along an edge bring for the singular functions: `stiffness` against w, `rotational` against the
/// slope across the edge. `position` is the edge's, `lines` those along it, `number` the number of the product of the
/// functions (0 for w, 1 for the slope) across and along it.
pub(super) struct EdgeSprings<'a> {
    /// The mesh.
    pub grid: &'a Grid,
    /// Lines along the edge.
    pub lines: &'a GridLines,
    /// Whether the edge runs along y.
    pub along_y: bool,
    /// Its place across.
    pub position: f64,
    /// Against deflection, per metre.
    pub stiffness: f64,
    /// Against the slope across the edge, per metre.
    pub rotational: f64,
    /// What the slope's unknowns are multiplied with to give a slope.
    pub slope_unit: f64,
}

impl EdgeSprings<'_> {
    /// Adds the edge springs' stiffness for the cells along the edge that exist.
    pub(super) fn add_stiffness_of_singular_functions_along_edge(
        &self,
        unknown_of_functions_across_and_along: impl Fn(usize, usize) -> Option<usize>,
        is_cell_present: impl Fn(usize) -> bool,
        entries: &mut MatrixEntries,
    ) {
        let grid = self.grid;
        let n = grid.element.element_order() + 1;
        let rule = gauss_legendre_rule_on_unit_interval(n + EXTRA_POINTS);
        for cell in (0..self.lines.count_cells()).filter(|cell| is_cell_present(*cell)) {
            let (from, to) = (self.lines.at[cell], self.lines.at[cell + 1]);
            let [x, y] = self.x_and_y_ranges_around_edge_section([from, to]);
            let active: Vec<(usize, &SingularFunction)> =
                grid.unknowns_and_singular_functions_reaching_into_rectangle([x[0], x[1], y[0], y[1]]).collect();
            if active.is_empty() {
                continue;
            }
            // A rectangle without height: the same cuts, by the distance from the line.
            let (centres, ends) =
                (collect_singular_and_blending_centres(&active), collect_function_ends_along_x_and_y(&active));
            let bounds = if self.along_y { [x[0], x[0], from, to] } else { [from, to, y[0], y[0]] };
            for QuadratureRectangle { bounds: part, .. } in
                cut_cell_into_rectangles(bounds, &centres, &ends, longer_side(bounds))
            {
                let stretch = if self.along_y { [part[2], part[3]] } else { [part[0], part[1]] };
                let along = DirectionQuadrature::new(grid, self.lines, cell, stretch, &rule);
                for ((at, weight), functions) in along.at.iter().zip(&along.weight).zip(&along.functions) {
                    self.add_singular_function_stiffness_at_edge_point(
                        *at,
                        *weight,
                        &functions[0],
                        cell,
                        &active,
                        &unknown_of_functions_across_and_along,
                        entries,
                    );
                }
            }
        }
    }

    /// x and y ranges of a stretch of the edge, with a hair of width across so that functions reaching it are found.
    fn x_and_y_ranges_around_edge_section(&self, stretch: [f64; 2]) -> [[f64; 2]; 2] {
        let hair = 1e-9 * (stretch[1] - stretch[0]);
        let across = [self.position - hair, self.position + hair];
        if self.along_y { [across, stretch] } else { [stretch, across] }
    }

    /// Adds what one quadrature point of the edge contributes.
    #[expect(clippy::too_many_arguments, reason = "a loop's body")]
    fn add_singular_function_stiffness_at_edge_point(
        &self,
        at: f64,
        weight: f64,
        functions: &[f64],
        cell: usize,
        active: &[(usize, &SingularFunction)],
        unknown_of_functions_across_and_along: &impl Fn(usize, usize) -> Option<usize>,
        entries: &mut MatrixEntries,
    ) {
        let jets: Vec<(f64, f64)> = active
            .iter()
            .map(|(_, f)| {
                let jet = if self.along_y {
                    f.evaluate_jet_at(self.position, at)
                } else {
                    f.evaluate_jet_at(at, self.position)
                };
                (jet.value, if self.along_y { jet.x } else { jet.y })
            })
            .collect();
        for ((e, _), (value, slope)) in active.iter().zip(&jets) {
            for (a, function) in functions.iter().enumerate() {
                let along = self.grid.function_index_along_one_axis(cell, a);
                if let Some(other) = unknown_of_functions_across_and_along(0, along) {
                    add_value_at_entry_and_transpose(entries, *e, other, weight * self.stiffness * value * function);
                }
                if let Some(other) = unknown_of_functions_across_and_along(1, along) {
                    add_value_at_entry_and_transpose(
                        entries,
                        *e,
                        other,
                        weight * self.rotational * slope * function * self.slope_unit,
                    );
                }
            }
            for ((f, _), (other_value, other_slope)) in active.iter().zip(&jets) {
                let value = self.stiffness * value * other_value + self.rotational * slope * other_slope;
                entries.add_entry_without_its_transpose(*e, *f, weight * value);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The integral of log r over a square around the singular point is known: for 0..1 x 0..1 it is
    /// (log 2 + pi/2 - 3) / 2.
    #[test]
    fn rectangles_integrate_a_logarithm() {
        let rule = gauss_legendre_rule_on_unit_interval(12);
        let integral = |bounds: Rectangle, at: (f64, f64)| {
            let mut sum = 0.0;
            let centre = SingularCentre { at, finest: f64::INFINITY };
            for QuadratureRectangle { bounds: [x0, x1, y0, y1], .. } in
                cut_cell_into_rectangles(bounds, &[centre], &[Vec::new(), Vec::new()], longer_side(bounds))
            {
                for (u, wu) in &rule {
                    for (v, wv) in &rule {
                        let (x, y) = (x0 + u * (x1 - x0) - at.0, y0 + v * (y1 - y0) - at.1);
                        sum += wu * wv * (x1 - x0) * (y1 - y0) * x.hypot(y).ln();
                    }
                }
            }
            sum
        };
        let quarter = 0.5 * (2.0_f64.ln() + std::f64::consts::FRAC_PI_2 - 3.0);
        assert!((integral([0.0, 1.0, 0.0, 1.0], (0.0, 0.0)) / quarter - 1.0).abs() < 1e-11);
        assert!((integral([-1.0, 1.0, -1.0, 1.0], (0.0, 0.0)) / (4.0 * quarter) - 1.0).abs() < 1e-11);
        // A cell beside the point and a long one.
        let whole = integral([0.0, 1.0, 0.0, 1.0], (0.0, 0.0));
        let parts = integral([0.0, 1.0, 0.0, 0.03], (0.0, 0.0)) + integral([0.0, 1.0, 0.03, 1.0], (0.0, 0.0));
        assert!((whole / parts - 1.0).abs() < 1e-11);
    }
}
