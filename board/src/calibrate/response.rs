//! Estimation of a camera's response from exposures of one still scene.
//!
//! The logarithms of a pixel's exposures in two frames differ by the logarithm of the frames' exposure ratio, independent of the pixel's
//! light: \[MitsunagaNayar1999\]. The response curve is a sum of Bernstein polynomials with ascending coefficients, hence monotone. The
//! exposure ratios are estimated together with the curve and weighted towards the declared ratios, since with other ratios any power of the
//! curve fits equally well.

use nalgebra::{DMatrix, DVector};

/// Number of Bernstein coefficients of a response curve.
pub(super) const COEFFICIENTS: usize = 9;

/// Range of the relative codes from which a response is estimated: below it noise and quantisation dominate, above it samples clip.
const USED: std::ops::Range<f32> = 0.05..0.96;

/// Least relative code of a pixel in the frame with the shorter exposure.
const LEAST: f64 = 0.035;

/// Weight in the loss of the second differences of the logarithms of a curve's increments.
const SMOOTH: f64 = 2.0;

/// Number of bins for the codes of the frame with the longer exposure, and least number of pixels in a bin.
const BINS: usize = 256;
const FEWEST_IN_BIN: usize = 8;

/// Standard deviation of the logarithm of a declared exposure ratio, and weight in the loss of all ratios together, which fix the power of
/// the curve.
const RATIO_DEVIATION: f64 = 0.01;
const RATIO_WEIGHT: f64 = 30.0;

/// Relative codes of one frame, 0 at black and 1 at white, for red, green and blue of each pixel.
#[derive(Clone, Debug, Default)]
pub struct Exposed {
    /// Declared exposure of the frame: time in seconds times gain.
    pub exposure: f64,
    /// Relative codes of the pixels of the frame.
    pub codes: Vec<[f32; 3]>,
}

/// Reasons why no response is computed from a burst.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ResponseRefusal {
    /// The burst has fewer frames than a response needs.
    #[error("found {0} frame(s), expected at least 3 exposures of one still scene")]
    FewFrames(usize),
    /// Too few pixels are well exposed in two neighbouring frames.
    #[error(
        "found {found} pixels that are well exposed in two neighbouring frames, expected at least {expected}: take exposures 1 to 2 stops apart of a scene with bright and dark parts"
    )]
    FewPixels {
        /// Number of well-exposed pixels that were found.
        found: usize,
        /// Least number of well-exposed pixels that is accepted.
        expected: usize,
    },
    /// The declared exposures are wrong, or the camera changes its response from frame to frame.
    #[error(
        "found exposures whose ratio is {estimated:.2} by the pictures, expected the declared {declared:.2}: check the exposure times, and \
         switch off automatic exposure, gain and white balance, wide dynamic range and tone mapping"
    )]
    Ratio {
        /// Ratio of two exposures that is estimated from the pictures.
        estimated: f64,
        /// Ratio of the two exposures that `burst.toml` declares.
        declared: f64,
    },
    /// The frames contradict each other at the fitted response.
    #[error(
        "found neighbouring exposures that disagree by {percent:.1} % in the median, expected at most {most_percent:.0} %: keep the scene and \
         the camera still, and switch off automatic exposure, gain and white balance, wide dynamic range, tone mapping, noise reduction \
         and sharpening"
    )]
    Contradiction {
        /// Median disagreement of neighbouring frames' relative exposures, per cent.
        percent: f64,
        /// Largest accepted median disagreement of the frames, per cent.
        most_percent: f64,
    },
}

/// Exposure ratio of two frames that are neighbours in the order of exposure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Neighbours {
    /// Declared ratio of the longer to the shorter exposure.
    pub declared: f64,
    /// Ratio of the longer to the shorter exposure estimated from the pictures.
    pub estimated: f64,
    /// Median relative difference between the relative exposures of the two frames' pixels.
    pub disagreement: f64,
}

/// A camera response with the quality of its fit.
#[derive(Clone, Debug, PartialEq)]
pub struct FittedResponse {
    /// Bernstein coefficients of the curves of red, green and blue.
    pub coefficients: [[f64; COEFFICIENTS]; 3],
    /// Pairs of neighbouring frames in ascending order of exposure.
    pub neighbours: Vec<Neighbours>,
    /// Median relative difference between relative exposures, over all pairs of frames.
    pub disagreement: f64,
}

/// Largest accepted relative deviation of an estimated exposure ratio from the declared one.
const MOST_RATIO: f64 = 0.3;

/// Largest accepted median relative difference between the relative exposures of neighbouring frames.
const MOST_DISAGREEMENT: f64 = 0.06;

/// Least number of pairs of codes from which a response is computed.
const FEWEST_PAIRS: usize = 100;

/// The codes of pixels that have the same code in the longer of two exposures.
#[derive(Clone, Copy, Debug)]
struct CodePair {
    channel: usize,
    /// Index of the frame with the longer exposure.
    step: usize,
    /// Values of the Bernstein polynomials at the codes of the shorter and of the longer exposure.
    shorter: [f64; COEFFICIENTS],
    longer: [f64; COEFFICIENTS],
    codes: [f64; 2],
    /// Number of pixels that have the pair of codes.
    count: f64,
}

/// Fits the response to frames in ascending order of exposure; `step` is the difference of relative code between two neighbouring codes.
///
/// # Errors
/// [`ResponseRefusal`] if the frames determine no response.
pub fn fit_response(frames: &[Exposed], step: f64) -> Result<FittedResponse, ResponseRefusal> {
    if frames.len() < 3 {
        return Err(ResponseRefusal::FewFrames(frames.len()));
    }
    let pairs = pairs(frames);
    if pairs.len() < FEWEST_PAIRS {
        return Err(ResponseRefusal::FewPixels { found: pairs.len(), expected: FEWEST_PAIRS });
    }
    let declared: Vec<f64> = frames.windows(2).map(|f| (f[1].exposure / f[0].exposure).ln()).collect();
    let problem = Problem { pairs: &pairs, declared: &declared, step };
    let starts = [1.0, 1.8, 2.6].map(|power| problem.solve(problem.start(power)));
    let best = starts
        .into_iter()
        .filter(|solution| solution.loss.is_finite())
        .min_by(|a, b| a.loss.total_cmp(&b.loss))
        .map(|solution| solution.parameters);
    let fitted = problem.result(&best.unwrap_or_else(|| problem.start(1.0)), frames);
    let is_off = |n: &&Neighbours| (n.estimated / n.declared).ln().abs() > MOST_RATIO;
    if let Some(&Neighbours { declared, estimated, .. }) = fitted.neighbours.iter().find(is_off) {
        return Err(ResponseRefusal::Ratio { estimated, declared });
    }
    if fitted.disagreement > MOST_DISAGREEMENT {
        let percent = 100.0 * fitted.disagreement;
        return Err(ResponseRefusal::Contradiction { percent, most_percent: 100.0 * MOST_DISAGREEMENT });
    }
    Ok(fitted)
}

/// Returns the values of the Bernstein polynomials of degree 8 at `x`.
fn bernstein(x: f64) -> [f64; COEFFICIENTS] {
    const BINOMIALS: [f64; COEFFICIENTS] = [1.0, 8.0, 28.0, 56.0, 70.0, 56.0, 28.0, 8.0, 1.0];
    std::array::from_fn(|i| BINOMIALS[i] * x.powi(i as i32) * (1.0 - x).powi(8 - i as i32))
}

fn pairs(frames: &[Exposed]) -> Vec<CodePair> {
    let mut pairs = Vec::new();
    for (step, pair) in frames.windows(2).enumerate() {
        for channel in 0..3 {
            pairs.extend(pairs_of(&pair[0], &pair[1], channel, step));
        }
    }
    pairs
}

/// Returns one pair for each code of the longer exposure, with the mean of the middle half of the codes that its pixels have in the shorter
/// exposure. The mean reduces the noise, and the outer halves contain textures that moved.
fn pairs_of(shorter: &Exposed, longer: &Exposed, channel: usize, step: usize) -> Vec<CodePair> {
    let mut bins: Vec<Vec<[f32; 2]>> = vec![Vec::new(); BINS];
    for (a, b) in shorter.codes.iter().zip(&longer.codes) {
        if USED.contains(&b[channel]) {
            bins[(b[channel] * BINS as f32) as usize % BINS].push([a[channel], b[channel]]);
        }
    }
    let pair = |bin: Vec<[f32; 2]>| {
        let MeanCodes { codes, count } = middle(bin)?;
        (codes[0] > LEAST).then(|| CodePair {
            channel,
            step,
            count,
            shorter: bernstein(codes[0]),
            longer: bernstein(codes[1]),
            codes,
        })
    };
    bins.into_iter().filter_map(pair).collect()
}

/// The mean codes of a group of pixels in two exposures.
struct MeanCodes {
    codes: [f64; 2],
    /// Number of pixels that were averaged.
    count: f64,
}

/// Averages the middle half of a bin, sorted by the shorter exposure's code; `None` if it has too few pixels.
fn middle(mut bin: Vec<[f32; 2]>) -> Option<MeanCodes> {
    bin.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let quarter = bin.len() / 4;
    let kept = bin.get(quarter..bin.len() - quarter).filter(|kept| kept.len() >= FEWEST_IN_BIN)?;
    let count = kept.len() as f64;
    let mean = |i: usize| kept.iter().map(|pair| f64::from(pair[i])).sum::<f64>() / count;
    Some(MeanCodes { codes: [mean(0), mean(1)], count })
}

/// Least-squares problem whose parameters are the logarithms of the curve's increments and of the exposure ratios.
struct Problem<'a> {
    pairs: &'a [CodePair],
    declared: &'a [f64],
    step: f64,
}

/// Parameters at a minimum of a [`Problem`].
struct Solution {
    /// Robust loss of the residuals at the parameters.
    loss: f64,
    parameters: DVector<f64>,
}

/// Values and slopes of a curve at both codes of a pair.
struct CurveValues {
    shorter: f64,
    longer: f64,
    slopes: [f64; 2],
}

impl Problem<'_> {
    /// Returns the initial parameters for a power law: nine logarithms of increments for each channel, then the logarithms of the ratios.
    fn start(&self, power: f64) -> DVector<f64> {
        let node = |i: usize| (i as f64 / (COEFFICIENTS - 1) as f64).powf(power);
        let increments = (0..COEFFICIENTS).map(|i| if i == 0 { -10.0 } else { (node(i) - node(i - 1)).ln() });
        let curves = (0..3).flat_map(|_| increments.clone());
        DVector::from_vec(curves.chain(self.declared.iter().copied()).collect())
    }

    fn coefficients(p: &DVector<f64>, channel: usize) -> [f64; COEFFICIENTS] {
        let increments: [f64; COEFFICIENTS] = std::array::from_fn(|i| p[channel * COEFFICIENTS + i].exp());
        let total: f64 = increments.iter().sum();
        let mut sum = 0.0;
        increments.map(|d| {
            sum += d / total;
            sum.min(1.0)
        })
    }

    fn values(pair: &CodePair, c: &[f64; COEFFICIENTS]) -> CurveValues {
        let dot = |basis: &[f64; COEFFICIENTS]| basis.iter().zip(c).map(|(b, c)| b * c).sum::<f64>();
        let slope = |x: f64| {
            let h = 1e-3;
            let at = |x: f64| dot(&bernstein(x));
            (at(x + h) - at(x - h)) / (2.0 * h)
        };
        CurveValues { shorter: dot(&pair.shorter), longer: dot(&pair.longer), slopes: pair.codes.map(slope) }
    }

    /// Returns the residuals, in standard deviations, of the pairs, of the ratios, and of a weak prior that limits the increments.
    fn residuals(&self, p: &DVector<f64>, weights: &[f64]) -> DVector<f64> {
        let curves: [[f64; COEFFICIENTS]; 3] = std::array::from_fn(|channel| Self::coefficients(p, channel));
        let ratios = 3 * COEFFICIENTS;
        let of_pair = |(pair, weight): (&CodePair, &f64)| {
            let dot = |basis: &[f64; COEFFICIENTS]| {
                basis.iter().zip(&curves[pair.channel]).map(|(b, c)| b * c).sum::<f64>()
            };
            weight * ((dot(&pair.longer) / dot(&pair.shorter)).ln() - p[ratios + pair.step])
        };
        let data = self.pairs.iter().zip(weights).map(of_pair);
        let off = |i: usize| (p[ratios + i] - self.declared[i]) / RATIO_DEVIATION;
        let held = (0..self.declared.len())
            .map(|i| RATIO_WEIGHT * off(i).signum() * (off(i) * off(i)).ln_1p().sqrt());
        // A constant curve fits exposure ratios of one: a ratio far from the declared one therefore costs more than the loss of the pairs.
        let leash = (0..self.declared.len()).map(|i| RATIO_WEIGHT * 0.05 * off(i));
        let weak = (0..ratios)
            .map(|i| if i % COEFFICIENTS == 0 { 0.5 * (p[i] + 12.0) } else { 0.01 * (p[i] + 2.0) });
        // Exposures in equal steps do not determine waves of the same period in the curve: the smoothest curve is selected.
        let bend = |i: usize| SMOOTH * (p[i - 1] - 2.0 * p[i] + p[i + 1]);
        let inner = (0..ratios).filter(|i| (2..COEFFICIENTS - 1).contains(&(i % COEFFICIENTS))).map(bend);
        DVector::from_vec(data.chain(held).chain(leash).chain(weak).chain(inner).collect())
    }

    /// Returns the weight of each pair from the quantisation and noise of both codes, as the curve propagates them; outliers have lower
    /// weights.
    fn weights(&self, p: &DVector<f64>) -> Vec<f64> {
        let curves: [[f64; COEFFICIENTS]; 3] = std::array::from_fn(|channel| Self::coefficients(p, channel));
        let ratios = 3 * COEFFICIENTS;
        let weight = |pair: &CodePair| {
            let v = Self::values(pair, &curves[pair.channel]);
            let relative = |slope: f64, value: f64| (self.step * slope / value).powi(2);
            let variance =
                (relative(v.slopes[0], v.shorter) + relative(v.slopes[1], v.longer)) / pair.count + 2.5e-5;
            let off = (v.longer / v.shorter).ln() - p[ratios + pair.step];
            (1.0 / (variance * (1.0 + off * off / (9.0 * variance)))).sqrt()
        };
        self.pairs.iter().map(weight).collect()
    }

    /// Minimises the loss by Levenberg-Marquardt from the parameters `p`, with weights that are updated in each step.
    fn solve(&self, mut p: DVector<f64>) -> Solution {
        let mut damping = 1e-2;
        for _ in 0..40 {
            let weights = self.weights(&p);
            let residuals = self.residuals(&p, &weights);
            let jacobian = self.jacobian(&p, &weights, &residuals);
            let (normal, right) = (jacobian.transpose() * &jacobian, jacobian.transpose() * &residuals);
            let mut damped = normal.clone();
            (0..p.len()).for_each(|i| damped[(i, i)] *= 1.0 + damping);
            let Some(step) = damped.cholesky().map(|c| c.solve(&right)) else { break };
            let next = &p - &step;
            let gained = self.residuals(&next, &weights).norm_squared() < residuals.norm_squared();
            damping = if gained { damping * 0.3 } else { damping * 8.0 };
            if gained {
                p = next;
            }
            if step.amax() < 1e-5 {
                break;
            }
        }
        let weights = self.weights(&p);
        let residuals = self.residuals(&p, &weights);
        // The weight of an outlier contains its residual: this factor is removed before the square enters the Cauchy loss.
        let cauchy = |r: f64| 9.0 * ((r * r / 9.0) / (1.0 - r * r / 9.0).max(1e-9)).ln_1p();
        let (data, held) = residuals.as_slice().split_at(weights.len());
        let loss = data.iter().copied().map(cauchy).sum::<f64>() + held.iter().map(|r| r * r).sum::<f64>();
        Solution { loss, parameters: p }
    }

    /// Returns the derivatives of the residuals with respect to the parameters, computed by finite differences.
    fn jacobian(&self, p: &DVector<f64>, weights: &[f64], residuals: &DVector<f64>) -> DMatrix<f64> {
        const H: f64 = 1e-5;
        let column = |i: usize| {
            let mut moved = p.clone();
            moved[i] += H;
            (self.residuals(&moved, weights) - residuals) / H
        };
        DMatrix::from_columns(&(0..p.len()).map(column).collect::<Vec<_>>())
    }

    fn result(&self, p: &DVector<f64>, frames: &[Exposed]) -> FittedResponse {
        let curves: [[f64; COEFFICIENTS]; 3] = std::array::from_fn(|channel| Self::coefficients(p, channel));
        let logarithms = |step: usize| sorted(logarithms(&frames[step..step + 2], &curves));
        let all: Vec<Vec<f64>> = (0..self.declared.len()).map(logarithms).collect();
        // If no samples are valid in both frames, the exposure ratio of the fit is used.
        let own = |step: usize| p[3 * COEFFICIENTS + step];
        let ratio = |(step, values): (usize, &Vec<f64>)| {
            if values.is_empty() { own(step) } else { middle_of(values) }
        };
        let ratios: Vec<f64> = all.iter().enumerate().map(ratio).collect();
        let off = |step: usize| sorted(all[step].iter().map(|v| (v - ratios[step]).exp_m1().abs()).collect());
        let off: Vec<Vec<f64>> = (0..all.len()).map(off).collect();
        let neighbours = |(step, declared): (usize, &f64)| Neighbours {
            declared: declared.exp(),
            estimated: ratios[step].exp(),
            disagreement: middle_of(&off[step]),
        };
        let neighbours = self.declared.iter().enumerate().map(neighbours).collect();
        FittedResponse { coefficients: curves, neighbours, disagreement: middle_of(&sorted(off.concat())) }
    }
}

fn sorted(mut values: Vec<f64>) -> Vec<f64> {
    values.sort_by(f64::total_cmp);
    values
}

/// Returns the median of the ascending values `sorted`.
fn middle_of(sorted: &[f64]) -> f64 {
    sorted.get(sorted.len() / 2).copied().unwrap_or(0.0)
}

/// Returns the logarithms of the exposure ratios of neighbouring frames, from the samples that the merge uses in both frames.
fn logarithms(frames: &[Exposed], curves: &[[f64; COEFFICIENTS]; 3]) -> Vec<f64> {
    logarithms_of(frames, |code, channel| {
        let basis = bernstein(code);
        basis.iter().zip(&curves[channel]).map(|(b, c)| b * c).sum::<f64>()
    })
}

/// Returns the logarithms of the exposure ratios of neighbouring frames, from the samples that the merge uses in both frames; `exposure`
/// converts a code and a channel to a relative exposure.
pub(super) fn logarithms_of(frames: &[Exposed], exposure: impl Fn(f64, usize) -> f64) -> Vec<f64> {
    const TRUSTED: std::ops::Range<f32> = 0.0627..0.98;
    let mut logarithms = Vec::new();
    for (a, b) in frames[0].codes.iter().zip(&frames[1].codes) {
        for channel in 0..3 {
            if TRUSTED.contains(&a[channel]) && TRUSTED.contains(&b[channel]) {
                let [a, b] = [a[channel], b[channel]].map(|code| exposure(code.into(), channel));
                logarithms.push((b / a).ln());
            }
        }
    }
    logarithms
}
