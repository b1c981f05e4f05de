//! What a point force does to a plate, as shape functions of their own.
//!
//! Around a point force a plate bends as r^2 log r: polynomial elements of any order get there only with the square of
//! their size. Each attachment therefore adds that very function to the mesh's (the "singular function method" of Fix,
//! Gulati and Wakoff 1973; "enrichment" in Strouboulis, Babuska and Copps 2000), times polynomials that bring it smoothly
//! to zero where an edge demands it. What is left for the elements begins with r^6 log r. On and near an edge it is the
//! half-plane's solution, with its mirror image; at a corner a force only twists the plate.

use super::wave::LogWave;
use crate::scene::Side;

/// Functions about one centre.
const PARTS: usize = 7;

/// A function's value and derivatives at a point.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FunctionJet {
    /// Value.
    pub value: f64,
    /// First derivative along x.
    pub x: f64,
    /// First derivative along y.
    pub y: f64,
    /// Second derivatives.
    pub xx: f64,
    /// Mixed one.
    pub xy: f64,
    /// Along y.
    pub yy: f64,
}

/// Functions about one centre, with n into the plate and t along an edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SingularSource {
    /// Where it is singular (m): at the attachment, or at its mirror image behind a border.
    pub centre: (f64, f64),
    /// The edge that n and t belong to.
    pub side: Side,
    /// What they are.
    pub terms: SingularTerms,
}

/// Functions about one centre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SingularTerms {
    /// Of isotropic plates: parts of r^2 log r, Re(z^2 log z), Re(z log z), Re(z* log z), log r, n and 1, z = n + j t = r e^(j angle).
    Round([f64; PARTS]),
    /// Of others.
    Wave(LogWave),
}

impl SingularTerms {
    fn scale_terms_by(self, factor: f64) -> Self {
        match self {
            Self::Round(parts) => Self::Round(parts.map(|part| factor * part)),
            Self::Wave(wave) => Self::Wave(LogWave { factor: factor * wave.factor, ..wave }),
        }
    }
}

/// Where a function lives along one direction: one at the centre, coming to zero at the ends that are blended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FunctionReach {
    /// The attachment.
    pub centre: f64,
    /// Lower end.
    pub from: f64,
    /// Upper end.
    pub to: f64,
    /// What happens at the lower end.
    pub at_from: FunctionEnd,
    /// At the upper end.
    pub at_to: FunctionEnd,
}

/// How a function ends. Its first three derivatives at the centre stay what they were, so that what is wrong with it
/// there is of the order r^6 log r; polynomials of low degree, as the elements have to follow them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FunctionEnd {
    /// As it is: a border that may move.
    Open,
    /// Zero: times 1 - u^4, u from 0 at the centre to 1 at the end.
    Pinned,
    /// Zero with its slope: times 1 - 5 u^4 + 4 u^5.
    Flat,
}

impl FunctionReach {
    /// Whether the range from `from` to `to` overlaps.
    #[must_use]
    pub fn overlaps_range(&self, from: f64, to: f64) -> bool {
        from < self.to && to > self.from
    }

    /// The blending polynomial and its first two derivatives.
    fn blending_value_and_derivatives_at(&self, coordinate: f64) -> [f64; 3] {
        let away = coordinate - self.centre;
        let (length, end, sign) = if away >= 0.0 {
            (self.to - self.centre, self.at_to, 1.0)
        } else {
            (self.centre - self.from, self.at_from, -1.0)
        };
        if coordinate < self.from || coordinate > self.to {
            return [0.0; 3];
        }
        let u = away.abs() / length;
        match end {
            _ if away == 0.0 => [1.0, 0.0, 0.0],
            FunctionEnd::Open => [1.0, 0.0, 0.0],
            FunctionEnd::Pinned => {
                [1.0 - u.powi(4), -4.0 * u.powi(3) / length * sign, -12.0 * u * u / (length * length)]
            }
            FunctionEnd::Flat => [
                1.0 - u.powi(4) * (5.0 - 4.0 * u),
                -20.0 * u.powi(3) * (1.0 - u) / length * sign,
                -20.0 * u * u * (3.0 - 4.0 * u) / (length * length),
            ],
        }
    }
}

/// What a free edge adds to r^2 log r (up to polynomials), so that the half-plane's edge carries no moment and no shear.
///
/// In the Fourier transform along the edge the force at n = d gives (1 + k |n - d|) e^(-k |n - d|) / k^3, and the edge
/// reflects (A + B k n) e^(-k n) with w_nn - nu k^2 w = 0 and w_nnn - (2 - nu) k^2 w_n = 0 at n = 0. Solved and transformed
/// back, with z = n + d + j t, beta = (1 - nu) / (3 + nu) and alpha = (5 + 2 nu + nu^2) / ((1 - nu) (3 + nu)):
/// -alpha Re(z^2 log z) + 2 beta (n + d) Re(z log z) - 4 beta d n log |z|.
///
/// `distance_over_scale` is d over the functions' scale.
#[must_use]
pub fn image_source_of_free_edge(
    side: Side,
    image: (f64, f64),
    distance_over_scale: f64,
    poisson: f64,
) -> SingularSource {
    let beta = (1.0 - poisson) / (3.0 + poisson);
    let alpha = (5.0 + 2.0 * poisson + poisson * poisson) / ((1.0 - poisson) * (3.0 + poisson));
    // (n + d) Re(z log z) is half of Re(z^2 log z) + r^2 log r, and (n + d) log r half of Re(z log z) + Re(z* log z).
    let slope = -2.0 * beta * distance_over_scale;
    SingularSource {
        centre: image,
        side,
        terms: SingularTerms::Round([
            beta,
            beta - alpha,
            slope,
            slope,
            4.0 * beta * distance_over_scale * distance_over_scale,
            0.0,
            0.0,
        ]),
    }
}

/// What a clamped edge adds to r^2 log r, so that the half-plane's edge neither moves nor turns (Boggio 1905):
/// -r^2 log |z| + 2 d n, r the distance from the force and z = n + d + j t that from its image.
///
/// `distance_over_scale` is d over the functions' scale.
#[must_use]
pub fn image_source_of_clamped_edge(side: Side, image: (f64, f64), distance_over_scale: f64) -> SingularSource {
    // r^2 = |z|^2 - 4 d (n + d) + 4 d^2, and n log |z| as in `image_source_of_free_edge`.
    let (slope, square) = (2.0 * distance_over_scale, distance_over_scale * distance_over_scale);
    let parts = [-1.0, 0.0, slope, slope, -4.0 * square, 2.0 * distance_over_scale, -2.0 * square];
    SingularSource { centre: image, side, terms: SingularTerms::Round(parts) }
}

impl SingularSource {
    /// What a pinned edge at `edge_position_m` (m, across it) adds for this: its mirror image, pulling the other way.
    #[must_use]
    pub fn mirror_across_pinned_edge(&self, edge: Side, edge_position_m: f64) -> Self {
        let (x, y) = self.centre;
        let (centre, side) = match edge {
            Side::Left | Side::Right => ((2.0 * edge_position_m - x, y), mirror_side_in_x(self.side)),
            Side::Top | Side::Bottom => ((x, 2.0 * edge_position_m - y), mirror_side_in_y(self.side)),
        };
        // Mirrored across its edge n goes along, mirrored along it t is turned round.
        let terms = match self.terms {
            SingularTerms::Wave(wave) if side == self.side => SingularTerms::Wave(wave.reverse_edge_direction()),
            terms => terms,
        };
        Self { centre, side, terms: terms.scale_terms_by(-1.0) }
    }
}

/// The side after mirroring x; the functions are even along the edge.
fn mirror_side_in_x(side: Side) -> Side {
    match side {
        Side::Left => Side::Right,
        Side::Right => Side::Left,
        other => other,
    }
}

/// The side after mirroring y.
fn mirror_side_in_y(side: Side) -> Side {
    match side {
        Side::Top => Side::Bottom,
        Side::Bottom => Side::Top,
        other => other,
    }
}

/// One such function.
#[derive(Clone, Debug, PartialEq)]
pub struct SingularFunction {
    /// Where it lives along x.
    pub x: FunctionReach,
    /// Along y.
    pub y: FunctionReach,
    /// What it is the sum of.
    pub sources: Vec<SingularSource>,
    /// Length that distances are measured in, in m.
    pub scale: f64,
    /// Distance (m) of the two places that it is a difference quotient of, infinite where it belongs to one: away from its
    /// centres it varies over no less.
    pub finest: f64,
}

impl SingularFunction {
    /// The function at a point (m), derivatives per metre. At its centre the second derivatives, which are unbounded, are 0.
    #[must_use]
    pub fn evaluate_jet_at(&self, x_m: f64, y_m: f64) -> FunctionJet {
        let (bx, by) = (self.x.blending_value_and_derivatives_at(x_m), self.y.blending_value_and_derivatives_at(y_m));
        if bx == [0.0; 3] || by == [0.0; 3] {
            return FunctionJet::default();
        }
        let s = self.scale;
        let mut f = FunctionJet::default();
        for source in &self.sources {
            let part = source.evaluate_jet_from_centre((x_m - source.centre.0) / s, (y_m - source.centre.1) / s);
            f.value += part.value;
            f.x += part.x;
            f.y += part.y;
            f.xx += part.xx;
            f.xy += part.xy;
            f.yy += part.yy;
        }
        let (fx, fy, fxx, fxy, fyy) = (f.x / s, f.y / s, f.xx / (s * s), f.xy / (s * s), f.yy / (s * s));
        FunctionJet {
            value: bx[0] * by[0] * f.value,
            x: by[0] * (bx[1] * f.value + bx[0] * fx),
            y: bx[0] * (by[1] * f.value + by[0] * fy),
            xx: by[0] * (bx[2] * f.value + 2.0 * bx[1] * fx + bx[0] * fxx),
            yy: bx[0] * (by[2] * f.value + 2.0 * by[1] * fy + by[0] * fyy),
            xy: bx[1] * by[1] * f.value + bx[1] * by[0] * fy + bx[0] * by[1] * fx + bx[0] * by[0] * fxy,
        }
    }
}

impl SingularSource {
    /// The source of a point force inside of a plate, r^2 log r.
    #[must_use]
    pub fn from_inner_point_force(centre: (f64, f64)) -> Self {
        Self { centre, side: Side::Left, terms: SingularTerms::Round([1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]) }
    }

    /// The source times a factor.
    #[must_use]
    pub fn scale_by(&self, factor: f64) -> Self {
        Self { terms: self.terms.scale_terms_by(factor), ..*self }
    }

    /// Its value at a distance from the centre in units of the scale; 0 with all derivatives at the centre.
    fn evaluate_jet_from_centre(&self, x_over_scale: f64, y_over_scale: f64) -> FunctionJet {
        let square = x_over_scale * x_over_scale + y_over_scale * y_over_scale;
        if square < f64::MIN_POSITIVE {
            return FunctionJet::default();
        }
        let (n, t) = match self.side {
            Side::Left => (x_over_scale, y_over_scale),
            Side::Right => (-x_over_scale, y_over_scale),
            Side::Top => (y_over_scale, x_over_scale),
            Side::Bottom => (-y_over_scale, x_over_scale),
        };
        let [value, dn, dt, dnn, dnt, dtt] = match &self.terms {
            SingularTerms::Round(parts) => sum_isotropic_terms_and_derivatives(parts, n, t),
            SingularTerms::Wave(wave) => wave.evaluate_wave_and_derivatives(n, t),
        };
        match self.side {
            Side::Left => FunctionJet { value, x: dn, y: dt, xx: dnn, xy: dnt, yy: dtt },
            Side::Right => FunctionJet { value, x: -dn, y: dt, xx: dnn, xy: -dnt, yy: dtt },
            Side::Top => FunctionJet { value, x: dt, y: dn, xx: dtt, xy: dnt, yy: dnn },
            Side::Bottom => FunctionJet { value, x: dt, y: -dn, xx: dtt, xy: -dnt, yy: dnn },
        }
    }
}

/// The functions of [`SingularTerms::Round`]: value, w_n, w_t, w_nn, w_nt, w_tt; not at their centre.
fn sum_isotropic_terms_and_derivatives(parts: &[f64; PARTS], n: f64, t: f64) -> [f64; 6] {
    let square = n * n + t * t;
    let [round, edge, slope, turned, single, straight, constant] = *parts;
    let log = 0.5 * square.ln();
    let angle = if edge == 0.0 && slope == 0.0 && turned == 0.0 { 0.0 } else { t.atan2(n) };
    let (n2, t2) = (n * n / square, t * t / square);
    // Each with w, w_n, w_t, w_nn, w_nt, w_tt. For w = Re W: w_n = Re W', w_t = -Im W', w_nn = -w_tt = Re W''; and the
    // angle's derivatives are -t / r^2 and n / r^2.
    let twice = 2.0 * log + 1.0;
    let mut w = [
        round * square * log,
        round * n * twice,
        round * t * twice,
        round * (twice + 2.0 * n2),
        round * 2.0 * n * t / square,
        round * (twice + 2.0 * t2),
    ];
    let mut add = |part: f64, values: [f64; 6]| {
        if part != 0.0 {
            w.iter_mut().zip(values).for_each(|(sum, value)| *sum += part * value);
        }
    };
    let curvature = 2.0 * log + 3.0;
    add(
        edge,
        [
            (n * n - t * t) * log - 2.0 * n * t * angle,
            n * twice - 2.0 * t * angle,
            -t * twice - 2.0 * n * angle,
            curvature,
            -2.0 * angle,
            -curvature,
        ],
    );
    let (over_n, over_t) = (n / square, t / square);
    add(slope, [n * log - t * angle, log + 1.0, -angle, over_n, over_t, -over_n]);
    add(
        turned,
        [
            n * log + t * angle,
            log + n2 - t2,
            angle + 2.0 * n * over_t,
            over_n * (n2 + 5.0 * t2),
            over_t * (t2 - 3.0 * n2),
            over_n * (3.0 * n2 - t2),
        ],
    );
    add(single, [log, over_n, over_t, (t2 - n2) / square, -2.0 * over_n * over_t, (n2 - t2) / square]);
    add(straight, [n, 1.0, 0.0, 0.0, 0.0, 0.0]);
    add(constant, [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    w
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reach(centre: f64, from: f64, to: f64) -> FunctionReach {
        FunctionReach {
            centre,
            from,
            to,
            at_from: if centre > from { FunctionEnd::Flat } else { FunctionEnd::Open },
            at_to: FunctionEnd::Flat,
        }
    }

    #[test]
    fn derivatives_agree_with_differences() {
        let sources = (0..PARTS).flat_map(|k| [(k, Side::Left, 0.0, -0.7), (k, Side::Top, -0.5, 0.0)]);
        for (k, side, x_from, y_from) in sources {
            let mut parts = [0.0; PARTS];
            parts[k] = 1.0;
            let sources = vec![SingularSource { centre: (0.0, 0.0), side, terms: SingularTerms::Round(parts) }];
            let f = SingularFunction {
                x: reach(0.0, x_from, 0.9),
                y: reach(0.0, y_from, 1.1),
                sources,
                scale: 0.8,
                finest: f64::INFINITY,
            };
            let h = 1e-5;
            for (x, y) in [(0.2, 0.3), (0.55, 0.1), (0.8, 0.9), (1e-3, 2e-3 + 0.04)] {
                let here = f.evaluate_jet_at(x, y);
                let [east, west, south, north] =
                    [(h, 0.0), (-h, 0.0), (0.0, h), (0.0, -h)].map(|(a, b)| f.evaluate_jet_at(x + a, y + b));
                let close = |a: f64, b: f64| assert!((a - b).abs() < 2e-6 * (1.0 + a.abs()), "{k} {x} {y}: {a} {b}");
                close(here.x, (east.value - west.value) / (2.0 * h));
                close(here.y, (south.value - north.value) / (2.0 * h));
                close(here.xx, (east.x - west.x) / (2.0 * h));
                close(here.yy, (south.y - north.y) / (2.0 * h));
                close(here.xy, (east.y - west.y) / (2.0 * h));
                close(here.xy, (south.x - north.x) / (2.0 * h));
            }
        }
    }

    /// Both functions are biharmonic away from the centre, which is what makes them solutions there.
    #[test]
    fn unblended_functions_are_biharmonic() {
        for k in 0..PARTS {
            let mut parts = [0.0; PARTS];
            parts[k] = 1.0;
            let source = SingularSource { centre: (0.0, 0.0), side: Side::Bottom, terms: SingularTerms::Round(parts) };
            let laplacian = |x: f64, y: f64| {
                let jet = source.evaluate_jet_from_centre(x, y);
                jet.xx + jet.yy
            };
            let (x, y, h) = (0.3, -0.4, 3e-4);
            let twice = laplacian(x + h, y) + laplacian(x - h, y) + laplacian(x, y + h) + laplacian(x, y - h)
                - 4.0 * laplacian(x, y);
            assert!((twice / (h * h)).abs() < 1e-3, "{k}: {twice}");
        }
    }

    #[test]
    fn functions_vanish_with_their_slopes_where_they_are_blended() {
        let f = SingularFunction {
            x: reach(0.0, -0.5, 0.9),
            y: reach(0.0, -0.7, 1.1),
            sources: vec![SingularSource::from_inner_point_force((0.0, 0.0))],
            scale: 1.0,
            finest: f64::INFINITY,
        };
        for (x, y) in [(-0.5, 0.2), (0.9, 0.3), (0.1, -0.7), (0.2, 1.1), (2.0, 0.0)] {
            let jet = f.evaluate_jet_at(x, y);
            assert!(jet.value.abs() < 1e-12 && jet.x.abs() < 1e-12 && jet.y.abs() < 1e-12);
        }
        assert_eq!(f.evaluate_jet_at(0.0, 0.0).value, 0.0);
    }

    /// A reach around `centre` whose ends are far away and hold nothing.
    fn make_open_reach(centre: f64) -> FunctionReach {
        FunctionReach { centre, from: -10.0, to: 10.0, at_from: FunctionEnd::Open, at_to: FunctionEnd::Open }
    }

    /// Neither moment nor shear on the free edge, wherever the force is.
    #[test]
    fn half_plane_has_a_free_edge() {
        let (poisson, d) = (0.33, 0.2);
        let sources = vec![
            SingularSource::from_inner_point_force((d, 0.0)),
            image_source_of_free_edge(Side::Left, (-d, 0.0), d, poisson),
        ];
        let f = SingularFunction {
            x: make_open_reach(d),
            y: make_open_reach(0.0),
            sources,
            scale: 1.0,
            finest: f64::INFINITY,
        };
        let h = 1e-4;
        let [mut moments, mut shears] = [Vec::new(), Vec::new()];
        for t in [-0.5, -0.1, 0.05, 0.3, 0.9] {
            let jet = f.evaluate_jet_at(0.0, t);
            let inner = [f.evaluate_jet_at(h, t), f.evaluate_jet_at(2.0 * h, t)];
            moments.push(jet.xx + poisson * jet.yy);
            // w_xxx + (2 - nu) w_xyy, from one-sided differences of the second order.
            let sum = |jet: &FunctionJet| jet.xx + (2.0 - poisson) * jet.yy;
            shears.push((4.0 * sum(&inner[0]) - sum(&inner[1]) - 3.0 * sum(&jet)) / (2.0 * h));
        }
        // A quadratic polynomial was left out: the moment may be constant, the shear is zero.
        assert!(moments.iter().all(|moment| (moment - moments[0]).abs() < 1e-9), "{moments:?}");
        assert!(shears.iter().all(|shear| shear.abs() < 1e-4), "{shears:?}");
    }

    #[test]
    fn half_planes_are_held_at_their_edges() {
        let d = 0.2;
        let inside = SingularSource::from_inner_point_force((d, 0.0));
        let with = |image: SingularSource| SingularFunction {
            x: make_open_reach(d),
            y: make_open_reach(0.0),
            sources: vec![inside, image],
            scale: 1.0,
            finest: f64::INFINITY,
        };
        let (clamped, pinned) = (
            with(image_source_of_clamped_edge(Side::Left, (-d, 0.0), d)),
            with(inside.mirror_across_pinned_edge(Side::Left, 0.0)),
        );
        for t in [-0.5, 0.0, 0.3, 0.9] {
            let (clamped, pinned) = (clamped.evaluate_jet_at(0.0, t), pinned.evaluate_jet_at(0.0, t));
            assert!(clamped.value.abs() < 1e-15 && clamped.x.abs() < 1e-15, "{clamped:?}");
            assert!(pinned.value.abs() < 1e-15 && pinned.xx.abs() < 1e-14, "{pinned:?}");
        }
    }
}
