use era_model::model::{Accuracy, BarePanel, Fineness, PanelModel};
use era_model::response::acceleration_curves;
use era_model::scene::{EXAMPLE_PLATE, Scene};
use std::time::Instant;
fn main() {
    let path = std::env::args().nth(1);
    let text = path.map_or(EXAMPLE_PLATE.to_owned(), |p| std::fs::read_to_string(p).unwrap());
    let scene = Scene::parse("s", &text).unwrap();
    let max = 400.0;
    let hz: Vec<f64> = (0..361).map(|k| 40.0 + k as f64).collect();
    let (l, w) = (scene.surface.length_m, scene.surface.width_m);
    let points: Vec<(f64, f64)> = [(0.13, 0.2), (0.5, 0.5), (0.77, 0.9), (0.02, 0.04), (0.31, 0.64)].iter().map(|(u, v)| (u * l, v * w)).collect();
    let curves = |m: &era_model::model::ReducedModel| points.iter().map(|p| acceleration_curves(m, &m.shape_at(p.0, p.1), &hz).unwrap()).collect::<Vec<_>>();
    let t = Instant::now();
    let reference = PanelModel::build(&scene, Accuracy::tolerance(1e-7).unwrap(), max).unwrap();
    let reduced = reference.reduce(max, &points).unwrap();
    println!("reference {} dofs order {} in {:?}, n {}", reference.dofs(), reference.order(), t.elapsed(), reduced.order());
    let r = curves(&reduced);
    let base = reference.fineness();
    let err = |c: &Vec<Vec<Vec<num_complex::Complex64>>>| {
        let mut worst = 0.0_f64;
        for (c, r) in c.iter().zip(&r) { for (c, r) in c.iter().zip(r) {
            let peak = r.iter().map(|z| z.norm()).fold(0.0, f64::max);
            worst = worst.max(c.iter().zip(r).map(|(a, b)| (a - b).norm() / peak).fold(0.0, f64::max));
        } }
        worst
    };
    for acc in [1e-2, 1e-3] {
        let t = Instant::now();
        let m = PanelModel::build(&scene, Accuracy::tolerance(acc).unwrap(), max).unwrap();
        let red = m.reduce(max, &[]).unwrap();
        println!("full order {} dofs {} n {} in {:?}: {:.1e}", m.order(), m.dofs(), red.order(), t.elapsed(), err(&curves(&red)));
    }
    for order in [7, 9, 11, 13, 15, 19] {
        for part in [1.0, 0.5, 0.34] {
        let t = Instant::now();
        let fineness = Fineness { order, cell_m: base.cell_m * part, ..base };
        let Ok(bare) = BarePanel::new(&scene, fineness, max) else { continue };
        let built = t.elapsed();
        let t = Instant::now();
        let red = bare.coupled(&scene).unwrap();
        let first = t.elapsed();
        let t = Instant::now();
        for _ in 0..10 { bare.coupled(&scene).unwrap(); }
        println!("order {order:2} part {part:4} dofs {:5} modes {:3} n {:3} built {:?} first {:?} again {:?}: {:.1e}", bare.dofs(), bare.modes(), red.order(), built, first, t.elapsed() / 10, err(&curves(&red)));
        }
    }
}
