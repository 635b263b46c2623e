//! Time per tick over the amount of work: the times of all sizes over viewpoints times people, and a straight line
//! through them.

use farfield_proto::order_statistics::mean_median;
use farfield_score::plot::{Layer, Plot, PlotAxis};

use super::report::{BenchRun, CostLine};

/// The measured sizes: viewpoints, people.
pub(super) const SIZES: [(usize, usize); 8] = [
    (4, 5),
    (4, 10),
    (8, 10),
    (8, 20),
    (12, 16),
    (12, 22),
    (16, 22),
    (28, 30),
];

/// A line for each number of threads: through the origin, with the median slope of all sizes, so that no single size
/// determines it.
pub(super) fn cost_lines(runs: &[BenchRun]) -> Vec<CostLine> {
    let mut threads: Vec<usize> = runs.iter().map(|run| run.threads).collect();
    threads.sort_unstable();
    threads.dedup();
    let line = |threads: usize| {
        let own = runs.iter().filter(|run| run.threads == threads);
        let mut slopes: Vec<f64> = own.map(|run| 1e3 * run.p50_ms / patches(run)).collect();
        slopes.sort_by(f64::total_cmp);
        let us_per_patch = mean_median(&slopes)?;
        let far = |ratio: f64| ratio.max(1.0 / ratio);
        let ratios = slopes.iter().map(|slope| slope / us_per_patch);
        let farthest = ratios.max_by(|a, b| far(*a).total_cmp(&far(*b)))?;
        Some(CostLine {
            threads,
            us_per_patch,
            farthest,
        })
    };
    threads.into_iter().filter_map(line).collect()
}

/// Times and lines as an SVG document.
pub(super) fn svg(runs: &[BenchRun], lines: &[CostLine], tick_ms: f64) -> String {
    let most_patches = runs.iter().map(patches).fold(1.0, f64::max);
    let most_ms = runs.iter().map(|run| run.p99_ms).fold(tick_ms, f64::max);
    let (right, top) = (1.05 * most_patches, 1.1 * most_ms);
    let mut layers = vec![Layer {
        name: format!("one tick at {:.0} Hz", 1e3 / tick_ms),
        colour: 6,
        lines: vec![vec![(0.0, tick_ms), (right, tick_ms)]],
        ..Layer::default()
    }];
    for (index, line) in lines.iter().enumerate() {
        let of = |ms: fn(&BenchRun) -> f64| {
            let own = runs.iter().filter(|run| run.threads == line.threads);
            own.map(|run| (patches(run), ms(run))).collect::<Vec<_>>()
        };
        let end = (right, 1e-3 * line.us_per_patch * right);
        let threads = line.threads;
        layers.push(Layer {
            name: format!("threads: {threads}, P50"),
            colour: 2 * index,
            lines: vec![vec![(0.0, 0.0), end]],
            points: of(|run| run.p50_ms),
        });
        layers.push(Layer {
            name: format!("threads: {threads}, P99"),
            colour: 2 * index + 1,
            points: of(|run| run.p99_ms),
            ..Layer::default()
        });
    }
    let plot = Plot {
        title: "Time per tick of fusion over viewpoints x people",
        size_px: [1000, 560],
        x: PlotAxis {
            description: "viewpoints x people",
            range: [0.0, right],
            is_logarithmic: false,
            label: |patches| format!("{patches:.0}"),
        },
        y: PlotAxis {
            description: "ms",
            range: [0.0, top],
            is_logarithmic: false,
            label: |ms| format!("{ms:.0}"),
        },
        layers,
        note: "",
    };
    plot.svg()
}

fn patches(run: &BenchRun) -> f64 {
    (run.viewpoints * run.people) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(viewpoints: usize, people: usize, threads: usize, p50_ms: f64) -> BenchRun {
        BenchRun {
            viewpoints,
            people,
            threads,
            ticks: 300,
            rounds: 5,
            ticks_with_detection: 5,
            p50_ms,
            p99_ms: 2.0 * p50_ms,
            typical_p99_ms: 1.5 * p50_ms,
            max_ms: 3.0 * p50_ms,
            agreement_share: 0.0,
            stages: Vec::new(),
            tracked: people,
        }
    }

    #[test]
    fn an_outlier_does_not_change_the_line_and_is_the_farthest() {
        let runs = [
            run(4, 5, 1, 0.8),
            run(8, 10, 1, 3.2),
            run(12, 22, 1, 21.12),
            run(4, 5, 2, 0.5),
        ];
        let [one, two] = cost_lines(&runs)[..] else {
            panic!("two numbers of threads");
        };
        assert_eq!((one.threads, two.threads), (1, 2));
        assert!((one.us_per_patch - 40.0).abs() < 1e-9);
        assert!((one.farthest - 2.0).abs() < 1e-9);
        assert!((two.us_per_patch - 25.0).abs() < 1e-9 && (two.farthest - 1.0).abs() < 1e-9);
    }

    #[test]
    fn the_plot_has_a_line_and_points_for_each_number_of_threads() {
        let runs = [run(4, 5, 1, 0.8), run(4, 5, 2, 0.5)];
        let drawn = svg(&runs, &cost_lines(&runs), 16.7);
        for part in [
            "<svg",
            "threads: 1, P50",
            "threads: 2, P99",
            "one tick at 60 Hz",
        ] {
            assert!(drawn.contains(part), "{part}");
        }
    }
}
