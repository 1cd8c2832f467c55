//! Comparison of the paper's findings with measurements.
//!
//! Sampling settings are compared by the frame time for equal quality, read off the curves: at 40 dB, from which on the paper sees
//! no artefacts any more, or at 30 dB if nothing reaches that. "Lit" findings must hold for every measured lighting.

use super::{Row, distinct};
use brickyard::volume::sampling::VIRTUAL_SAMPLES;
use brickyard::volume::{Filter, LightingModel, Method};
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

/// Figure of a row for comparing methods.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Estimator {
    /// Signal-to-noise ratio by the variance of RGB, as in the paper.
    Variance,
    /// Signal-to-noise ratio against the truth.
    Truth,
}

impl Estimator {
    /// Returns this figure of a row, dB.
    pub fn db(self, row: &Row) -> f64 {
        match self {
            Self::Variance => row.rgb_db,
            Self::Truth => row.truth_db,
        }
    }
}

/// One of the paper's findings, and the measurement about it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Finding {
    /// The paper's claim.
    pub claim: &'static str,
    /// Figure for comparing the methods.
    pub by: Estimator,
    /// Whether the measurement agrees; `None` if it is inconclusive.
    pub agrees: Option<bool>,
    /// Measured values, in words.
    pub measured: String,
}

/// Qualities for comparison, decibels; the first that any setting reaches is used.
const TARGETS_DB: [f64; 2] = [40.0, 30.0];

/// Largest good multiple of the least time.
const GOOD: f64 = 1.25;

/// The paper's example: samples per voxel for 10, 20, 30 and 40 dB.
const EXAMPLE: [(f64, f64); 4] = [(10.0, 1.2), (20.0, 2.2), (30.0, 4.3), (40.0, 6.9)];

/// Largest factor from the example's rates in agreement.
const EXAMPLE_TIMES: f64 = 1.25;

/// Methods with their times for a quality, the fastest first.
struct Ranking {
    target_db: f64,
    times: Vec<(Method, f64)>,
}

impl Ranking {
    /// Ranks the methods for one filter and lighting. `None` if fewer than two methods were measured, or none is good enough.
    fn new(rows: &[Row], by: Estimator, filter: Filter, lighting: LightingModel) -> Option<Self> {
        let is_asked = |row: &&Row| row.filter == filter && row.lighting == lighting && row.is_usual();
        let rows: Vec<&Row> = rows.iter().filter(is_asked).collect();
        let curve = |method: Method| -> Vec<(f64, f64)> {
            let rows = rows.iter().filter(|row| row.method == method);
            rows.map(|row| (row.cpu_ms, by.db(row))).collect()
        };
        let measured: Vec<_> = Method::ALL.into_iter().map(|m| (m, curve(m))).filter(|(_, c)| !c.is_empty()).collect();
        if measured.len() < 2 {
            return None;
        }
        TARGETS_DB.into_iter().find_map(|target_db| {
            let time = |(method, curve): &(Method, Vec<(f64, f64)>)| Some((*method, reached_at(curve, target_db)?));
            let mut times: Vec<(Method, f64)> = measured.iter().filter_map(time).collect();
            times.sort_by(|a, b| a.1.total_cmp(&b.1));
            (!times.is_empty()).then_some(Self { target_db, times })
        })
    }

    fn best(&self) -> Method {
        self.times[0].0
    }

    fn text(&self) -> String {
        let times: Vec<String> = self.times.iter().map(|(m, ms)| format!("{} {ms:.0} ms", name(*m))).collect();
        format!("{:.0} dB: {}", self.target_db, times.join(", "))
    }
}

/// Position at which a curve of `(x, dB)` reaches a quality, interpolated in powers of x; its first point if that is good enough
/// already. `None` if it never does.
fn reached_at(curve: &[(f64, f64)], target_db: f64) -> Option<f64> {
    let mut curve = curve.to_vec();
    curve.sort_by(|a, b| a.0.total_cmp(&b.0));
    let i = curve.iter().position(|(_, db)| *db >= target_db)?;
    let Some(&(x0, db0)) = i.checked_sub(1).and_then(|before| curve.get(before)) else { return Some(curve[i].0) };
    let (x1, db1) = curve[i];
    let share = if db1.is_finite() { (target_db - db0) / (db1 - db0) } else { 1.0 };
    Some(x0 * (x1 / x0).powf(share))
}

/// Returns a method's name on the command line.
pub fn name(method: Method) -> &'static str {
    match method {
        Method::Udvr => "udvr",
        Method::Pdvr => "pdvr",
        Method::Lvs => "lvs",
        Method::Cvs => "cvs",
        Method::Asm => "asm",
        Method::Plvs => "plvs",
        Method::Pcvs => "pcvs",
    }
}

/// Compares rows with all of the paper's findings, by one figure. The rows of each method must be in the order of rising rates.
pub fn findings(rows: &[Row], by: Estimator) -> Vec<Finding> {
    let finding = |claim, (agrees, measured): (Option<bool>, String)| Finding { claim, by, agrees, measured };
    let lit = distinct(rows.iter().map(|row| row.lighting).filter(|lighting| *lighting != LightingModel::None));
    let best = |methods: &'static [Method]| move |ranking: &Ranking| methods.contains(&ranking.best());
    let is_good = |ranking: &Ranking| {
        ranking.times.iter().any(|(method, ms)| *method == Method::Asm && *ms <= GOOD * ranking.times[0].1)
    };
    vec![
        finding(
            "Pre-integrated (PDVR) is best unlit with trilinear filtering",
            ranked(rows, by, Filter::Trilinear, &[LightingModel::None], best(&[Method::Pdvr])),
        ),
        finding(
            "Virtual samples, pre-integrated (PLVS or PCVS), are best lit with tricubic filtering",
            ranked(rows, by, Filter::Tricubic, &lit, best(&[Method::Plvs, Method::Pcvs])),
        ),
        finding(
            "The adaptive step (ASM) is good lit with trilinear filtering (at most a quarter slower than the best)",
            ranked(rows, by, Filter::Trilinear, &lit, is_good),
        ),
        finding("Plain sampling (UDVR) is almost never efficient", plain(rows, by, &lit)),
        finding(
            "Three virtual samples to a segment are the optimum (at most a quarter slower than the best, in three of four cases)",
            optimum(rows, by),
        ),
        finding(
            "30 to 40 dB is acceptable, and above 40 nothing is seen (in at most a twentieth of the pixels)",
            seen(rows, by),
        ),
        finding("An example: 10 dB at 1.2 samples a voxel, 20 at 2.2, 30 at 4.3, 40 at 6.9", example(rows, by)),
    ]
}

fn ranked(
    rows: &[Row],
    by: Estimator,
    filter: Filter,
    lightings: &[LightingModel],
    holds: impl Fn(&Ranking) -> bool,
) -> (Option<bool>, String) {
    let rankings: Vec<Ranking> = lightings.iter().filter_map(|&model| Ranking::new(rows, by, filter, model)).collect();
    if rankings.is_empty() {
        return (None, "not measured".into());
    }
    let texts: Vec<String> = rankings.iter().map(Ranking::text).collect();
    (Some(rankings.iter().all(holds)), texts.join("; "))
}

fn plain(rows: &[Row], by: Estimator, lit: &[LightingModel]) -> (Option<bool>, String) {
    let lightings = || lit.iter().copied().chain([LightingModel::None]);
    let looks = Filter::ALL.into_iter().flat_map(|filter| lightings().map(move |model| (filter, model)));
    let rankings: Vec<Ranking> = looks.filter_map(|(filter, model)| Ranking::new(rows, by, filter, model)).collect();
    if rankings.is_empty() {
        return (None, "not measured".into());
    }
    let best = rankings.iter().filter(|ranking| ranking.best() == Method::Udvr).count();
    // One in four may be the exception.
    (Some(4 * best <= rankings.len()), format!("the fastest in {best} of {} combinations", rankings.len()))
}

/// How often each number of virtual samples is the fastest, and three are good.
fn optimum(rows: &[Row], by: Estimator) -> (Option<bool>, String) {
    let with_samples = rows.iter().filter(|row| row.virtual_samples.is_some());
    let cases = distinct(with_samples.map(|row| (row.filter, row.lighting, row.method)));
    let (mut best, mut good, mut asked) = (BTreeMap::<u8, usize>::new(), 0, 0);
    for case in cases {
        let rows = || rows.iter().filter(|row| (row.filter, row.lighting, row.method) == case);
        let time = |count: u8, target_db: f64| {
            let of_count = rows().filter(|row| row.virtual_samples == Some(count));
            reached_at(&of_count.map(|row| (row.cpu_ms, by.db(row))).collect::<Vec<_>>(), target_db)
        };
        let counts: BTreeSet<u8> = rows().filter_map(|row| row.virtual_samples).collect();
        let times_at = |db: f64| counts.iter().filter_map(|&count| Some((count, time(count, db)?))).collect::<Vec<_>>();
        let times = TARGETS_DB.map(times_at).into_iter().find(|times| !times.is_empty()).unwrap_or_default();
        let fastest = times.iter().min_by(|a, b| a.1.total_cmp(&b.1));
        let Some(&(count, least)) = fastest.filter(|_| counts.len() > 1 && counts.contains(&VIRTUAL_SAMPLES)) else {
            continue;
        };
        asked += 1;
        *best.entry(count).or_default() += 1;
        good += times.iter().any(|&(count, ms)| count == VIRTUAL_SAMPLES && ms <= GOOD * least) as usize;
    }
    if asked == 0 {
        return (None, "not measured".into());
    }
    let bests: Vec<String> = best.iter().map(|(count, times)| format!("{count} in {times}")).collect();
    let text = format!("fastest of {asked} cases: {}; three are good in {good}", bests.join(", "));
    (Some(4 * good >= 3 * asked), text)
}

/// Fraction of pixels with a noticeable difference from the truth, by quality.
fn seen(rows: &[Row], by: Estimator) -> (Option<bool>, String) {
    let share = |db: Range<f64>| {
        let shares: Vec<f64> = rows.iter().filter(|row| db.contains(&by.db(row))).map(|row| row.noticed).collect();
        (!shares.is_empty()).then(|| shares.iter().sum::<f64>() / shares.len() as f64)
    };
    let words = |share: Option<f64>| share.map_or("–".to_string(), |share| format!("{:.1} %", 100.0 * share));
    // Just above 40 dB: pictures far above it are no evidence for that limit.
    let [low, high] = [share(30.0..40.0), share(40.0..45.0)];
    (high.map(|share| share <= 0.05), format!("noticed at 30 to 40 dB: {}; at 40 to 45: {}", words(low), words(high)))
}

/// Plain, unlit, trilinear: the paper does not specify its example.
fn example(rows: &[Row], by: Estimator) -> (Option<bool>, String) {
    let is_plain =
        |row: &&Row| (row.method, row.filter, row.lighting) == (Method::Udvr, Filter::Trilinear, LightingModel::None);
    let curve: Vec<(f64, f64)> = rows.iter().filter(is_plain).map(|row| (row.samples_per_voxel, by.db(row))).collect();
    let Some(&(least, _)) = curve.first() else { return (None, "not measured".into()) };
    let places = EXAMPLE.map(|(db, rate)| (db, rate, reached_at(&curve, db)));
    let text = places.map(|(db, _, found)| match found {
        Some(found) if found <= least => format!("{db:.0} dB at {least:.1} or less"),
        Some(found) => format!("{db:.0} dB at {found:.1}"),
        None => format!("{db:.0} dB never"),
    });
    let agrees = places.iter().all(|(_, rate, found)| match found {
        Some(found) if *found <= least => *rate <= least * EXAMPLE_TIMES,
        Some(found) => (rate / EXAMPLE_TIMES..=rate * EXAMPLE_TIMES).contains(found),
        None => false,
    });
    (Some(agrees), format!("plain, unlit, trilinear: {}", text.join(", ")))
}

/// Findings by both figures as a Markdown table.
pub fn table(rows: &[Row]) -> String {
    let by = |estimator| findings(rows, estimator);
    let word = |agrees| match agrees {
        Some(true) => "yes",
        Some(false) => "no",
        None => "not measured",
    };
    let mut text =
        String::from("| The paper | by variance | | against the truth | |\n| --- | --- | --- | --- | --- |\n");
    for (a, b) in by(Estimator::Variance).into_iter().zip(by(Estimator::Truth)) {
        text +=
            &format!("| {} | {} | {} | {} | {} |\n", a.claim, word(a.agrees), a.measured, word(b.agrees), b.measured);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(method: Method, filter: Filter, lighting: LightingModel, rate: f64, db: f64, cpu_ms: f64) -> Row {
        let (pixels, frame_ms) = (9, cpu_ms);
        Row {
            method,
            virtual_samples: method.has_virtual_samples().then_some(VIRTUAL_SAMPLES),
            filter,
            lighting,
            samples_per_voxel: rate,
            pixels,
            rgb_db: db,
            ycbcr_db: db,
            hsl_db: db,
            truth_db: db - 3.0,
            noticed: 0.1 * 10f64.powf((40.0 - db) / 20.0),
            frame_ms,
            cpu_ms,
        }
    }

    fn agrees(rows: &[Row]) -> Vec<Option<bool>> {
        findings(rows, Estimator::Variance).into_iter().map(|finding| finding.agrees).collect()
    }

    #[test]
    fn curves_are_read_between_their_points() {
        let curve = [(8.0, 35.0), (2.0, 25.0), (32.0, 55.0)];
        assert_eq!(reached_at(&curve, 20.0), Some(2.0));
        assert_eq!(reached_at(&curve, 30.0), Some(4.0));
        assert_eq!(reached_at(&curve, 45.0), Some(16.0));
        assert_eq!(reached_at(&curve, 60.0), None);
        assert_eq!(reached_at(&[(1.0, 20.0), (2.0, f64::INFINITY)], 40.0), Some(2.0));
    }

    #[test]
    fn the_fastest_at_the_same_quality_is_best() {
        let (none, phong) = (LightingModel::None, LightingModel::Phong);
        let (linear, cubic) = (Filter::Trilinear, Filter::Tricubic);
        let mut rows = vec![
            // Plain is faster, but not good enough.
            row(Method::Udvr, linear, none, 1.0, 30.0, 10.0),
            row(Method::Udvr, linear, none, 2.0, 36.0, 20.0),
            row(Method::Udvr, linear, none, 4.0, 42.0, 40.0),
            row(Method::Pdvr, linear, none, 1.0, 41.0, 15.0),
        ];
        assert_eq!(agrees(&rows), [Some(true), None, None, Some(true), None, Some(false), Some(false)]);
        rows.push(row(Method::Asm, linear, none, 1.0, 45.0, 14.0));
        assert_eq!(agrees(&rows)[0], Some(false), "ASM is faster");
        // None reaches 40, so 30 decides, and there plain is fastest.
        rows.push(row(Method::Udvr, cubic, phong, 1.0, 31.0, 10.0));
        rows.push(row(Method::Pcvs, cubic, phong, 1.0, 39.0, 11.0));
        assert_eq!((agrees(&rows)[1], agrees(&rows)[3]), (Some(false), Some(false)));
        rows.push(row(Method::Udvr, linear, phong, 1.0, 41.0, 10.0));
        rows.push(row(Method::Asm, linear, phong, 1.0, 41.0, 12.4));
        assert_eq!(agrees(&rows)[2], Some(true), "within a quarter");
        // Against the truth all is 3 dB less.
        let by_truth = findings(&rows, Estimator::Truth);
        assert!(by_truth[0].measured.starts_with("40 dB: asm 14 ms"), "{by_truth:?}");
        assert!(table(&rows).contains("| no | 40 dB: asm 14 ms, pdvr 15 ms, udvr 32 ms |"), "{}", table(&rows));
    }

    #[test]
    fn the_best_number_of_virtual_samples_is_found() {
        let with = |virtual_samples, db, cpu_ms| Row {
            virtual_samples: Some(virtual_samples),
            ..row(Method::Lvs, Filter::Trilinear, LightingModel::None, 1.0, db, cpu_ms)
        };
        let found = |rows: &[Row]| optimum(rows, Estimator::Variance);
        assert_eq!(found(&[with(3, 41.0, 10.0)]).0, None, "one number is no choice");
        let (agrees, text) = found(&[with(1, 20.0, 1.0), with(2, 41.0, 9.0), with(3, 41.0, 10.0)]);
        assert_eq!((agrees, &*text), (Some(true), "fastest of 1 cases: 2 in 1; three are good in 1"));
        assert_eq!(found(&[with(2, 41.0, 7.0), with(3, 41.0, 10.0)]).0, Some(false));
        // None has 40 dB, and at 30 three are not there.
        assert_eq!(found(&[with(2, 35.0, 7.0), with(3, 25.0, 10.0)]).0, Some(false));
    }

    #[test]
    fn the_example_agrees_with_itself() {
        let rows = |times: f64| -> Vec<Row> {
            let row = |(db, rate): (f64, f64)| {
                row(Method::Udvr, Filter::Trilinear, LightingModel::None, rate * times, db, 1.0)
            };
            EXAMPLE.map(row).to_vec()
        };
        assert_eq!([1.0, 1.2, 1.4].map(|times| agrees(&rows(times))[6]), [Some(true), Some(true), Some(false)]);
        assert_eq!(agrees(&rows(1.0)[..3])[6], Some(false), "40 dB is never reached");
    }
}
