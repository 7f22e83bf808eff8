//! Curves that turn a photograph's levels into a picture's, and which of them explains the levels of pictures.

use glam::{DMat4, DVec4};
use sharp::color::{linear_from_srgb, srgb_from_linear};

/// Levels outside this range may be clipped.
const UNCLIPPED: std::ops::RangeInclusive<u8> = 12..=247;
/// A curve explains the levels if it reduces the squared error to at most this fraction.
const MAX_EXPLAINED_ERROR: f64 = 0.25;
/// A curve with more parameters is preferred if its squared error is below this fraction of the simpler curve's.
const MAX_BETTER_ERROR: f64 = 0.6;
/// A cubic curve is reported only if its squared error is at most this fraction of the best line's, or if it raises
/// contrast at least by [`MIN_RAISED_CONTRAST`]. Methods that blur or hedge never raise contrast.
const MAX_CUBIC_ERROR: f64 = 0.35;
const MIN_RAISED_CONTRAST: f64 = 1.15;
/// A cubic curve is reported only if it leaves a root mean square difference of at most this, in levels. Poor
/// predictions with holes differ by more from any curve.
const MAX_OFF_CUBIC: f64 = 5.0;
/// A curve that changes contrast is reported only if the mean difference of the levels is at least this fraction of
/// their root mean square difference, or if the curve explains the levels clearly better than a mere loss of contrast.
const MIN_MEAN_SHARE: f64 = 0.7;
/// Gains count as a white balance if the gains of two channels differ at least by this factor.
const MIN_BALANCE: f64 = 1.06;

/// A curve from a photograph's levels, 0..1, to a picture's.
#[derive(Debug, Clone, Copy)]
pub(super) enum Curve {
    /// The level to the power of `gamma`, multiplied by a factor per channel.
    Power { gains: [f64; 3], gamma: f64 },
    /// Linear light is multiplied by a factor.
    Exposure(f64),
    /// A factor and an offset, alike for all channels.
    Line { slope: f64, offset: f64 },
    /// Maps linear light x to x / (1 + x).
    Reinhard,
    /// The coefficients of a cubic polynomial that rises, by ascending power.
    Cubic([f64; 4]),
}

impl Curve {
    const AS_READ: Self = Self::Power {
        gains: [1.0; 3],
        gamma: 1.0,
    };

    fn of(self, channel: usize, level: f64) -> f64 {
        match self {
            Self::Power { gains, gamma } => gains[channel] * level.powf(gamma),
            Self::Exposure(factor) => {
                let light = factor as f32 * linear_from_srgb(level as f32);
                f64::from(srgb_from_linear(light))
            }
            Self::Line { slope, offset } => slope * level + offset,
            Self::Reinhard => {
                let light = linear_from_srgb(level as f32);
                f64::from(srgb_from_linear(light / (1.0 + light)))
            }
            Self::Cubic(coefficients) => {
                let sum = coefficients
                    .iter()
                    .rev()
                    .fold(0.0, |sum, c| sum * level + c);
                sum.clamp(0.0, 1.0)
            }
        }
    }

    /// The cubic polynomial that fits the pairs best by least squares; `None` if it decreases within the range of the
    /// photograph's levels.
    fn cubic(pairs: &[LevelPair]) -> Option<Self> {
        let (mut normal, mut sums) = (DMat4::from_diagonal(DVec4::splat(1e-9)), DVec4::ZERO);
        for (_, from, to) in pairs {
            let row = DVec4::new(1.0, *from, from * from, from.powi(3));
            normal += DMat4::from_cols(row.x * row, row.y * row, row.z * row, row.w * row);
            sums += *to * row;
        }
        let curve = Self::Cubic((normal.inverse() * sums).to_array());
        let levels = pairs.iter().map(|pair| pair.1);
        let lowest = levels.clone().fold(1.0, f64::min);
        let highest = levels.fold(0.0, f64::max);
        let steps = (0..=16).map(|k| lowest + (highest - lowest) * f64::from(k) / 16.0);
        let levels: Vec<f64> = steps.map(|level| curve.of(0, level)).collect();
        levels.is_sorted().then_some(curve)
    }

    /// The rest of a sentence that begins with "its pictures".
    pub(super) fn text(self) -> String {
        let ([red, green, blue], gamma) = match self {
            Self::Power { gains, gamma } => (gains, gamma),
            Self::Exposure(factor) => {
                return format!(
                    "have {factor:.2} times the linear light of the photographs, as with another exposure ({:+.2} EV)",
                    factor.log2()
                );
            }
            Self::Line { slope, offset } => {
                let [black, white] = [offset, slope + offset].map(|v| (255.0 * v).round());
                return format!(
                    "have {slope:.2} times the contrast of the photographs, with black at level {black} and white at \
                     {white}, as if they were blended with one colour or had another range of levels"
                );
            }
            Self::Reinhard => {
                return "look like the photographs after Reinhard's tone mapping (x / (1 + x) of linear light)"
                    .to_owned();
            }
            Self::Cubic(_) => {
                let [low, middle, high] =
                    [64.0, 128.0, 192.0].map(|level| (255.0 * self.of(0, level / 255.0)).round());
                return format!(
                    "look as if they had another tone curve, which turns the photographs' levels 64, 128 and 192 into \
                     {low}, {middle} and {high}, as after filmic tone mapping (ACES, for example)"
                );
            }
        };
        let most = red.max(green).max(blue);
        let is_balance = most / red.min(green).min(blue) >= MIN_BALANCE;
        if gamma != 1.0 {
            let times = if is_balance {
                format!("{red:.2}, {green:.2} and {blue:.2} (red, green and blue) times ")
            } else if (green - 1.0).abs() >= MIN_BALANCE - 1.0 {
                format!("{green:.2} times ")
            } else {
                String::new()
            };
            return format!(
                "look as if they had another tone curve, with {times}the photographs' levels (0 to 1) to the power of \
                 {gamma:.2}, as after tone mapping or with another gamma"
            );
        }
        if is_balance {
            format!(
                "have {red:.2}, {green:.2} and {blue:.2} times the red, green and blue of the photographs, as with another \
                 white balance"
            )
        } else {
            format!(
                "have {green:.2} times the levels of the photographs, as with another exposure{}",
                if most < 1.0 {
                    " or colours that were multiplied by alpha"
                } else {
                    ""
                }
            )
        }
    }
}

/// Channel, level of a photograph, and the picture's level at the same quantile.
pub(super) type LevelPair = (usize, f64, f64);

pub(super) fn level_pairs(from: &[[u8; 5]; 3], to: &[[u8; 5]; 3]) -> Vec<LevelPair> {
    let all = (0..3).flat_map(|channel| (0..5).map(move |k| (channel, k)));
    let levels = all.map(|(channel, k)| (channel, from[channel][k], to[channel][k]));
    let unclipped =
        levels.filter(|(_, from, to)| UNCLIPPED.contains(from) && UNCLIPPED.contains(to));
    unclipped
        .map(|(channel, from, to)| (channel, f64::from(from) / 255.0, f64::from(to) / 255.0))
        .collect()
}

/// Sum of squared differences after applying `curve`.
fn error(pairs: &[LevelPair], curve: Curve) -> f64 {
    let off = |(channel, from, to): &LevelPair| (curve.of(*channel, *from) - to).powi(2);
    pairs.iter().map(off).sum()
}

/// The line that fits best by least squares, as slope and offset.
fn line(pairs: &[LevelPair]) -> (f64, f64) {
    let count = pairs.len().max(1) as f64;
    let mean = |of: fn(&LevelPair) -> f64| pairs.iter().map(of).sum::<f64>() / count;
    let (x, y) = (mean(|pair| pair.1), mean(|pair| pair.2));
    let sum =
        |of: &dyn Fn(f64, f64) -> f64| pairs.iter().map(|p| of(p.1 - x, p.2 - y)).sum::<f64>();
    let slope = sum(&|x, y| x * y) / sum(&|x, _| x * x).max(1e-9);
    (slope, y - slope * x)
}

/// The curve with the fewest parameters that explains the pairs of levels; `None` if no curve does, or if the root mean
/// square difference of the levels is below `min_off`, in levels.
pub(super) fn explaining(pairs: &[LevelPair], min_off: f64) -> Option<Curve> {
    let logarithms = pairs
        .iter()
        .map(|(channel, from, to)| (*channel, from.ln(), to.ln()));
    let mean = |of: fn((usize, f64, f64)) -> f64, channel: usize| {
        let own = logarithms.clone().filter(|pair| pair.0 == channel).map(of);
        let count = own.clone().count().max(1) as f64;
        own.sum::<f64>() / count
    };
    let means: [[f64; 2]; 3] = std::array::from_fn(|c| [mean(|p| p.1, c), mean(|p| p.2, c)]);
    let slope = |centres: [[f64; 2]; 3]| {
        let centred = logarithms
            .clone()
            .map(|(c, x, y)| (x - centres[c][0], y - centres[c][1]));
        let [xy, xx] = centred.fold([0.0, 1e-9], |[xy, xx], (x, y)| [xy + x * y, xx + x * x]);
        xy / xx
    };
    let power = |gamma: f64, gains: [f64; 3]| Curve::Power { gains, gamma };
    let gains = |gamma: f64| means.map(|[x, y]| (y - gamma * x).exp());
    let factor = means.iter().map(|[x, y]| y - x).sum::<f64>() / 3.0;
    let own = slope(means);
    let stops = pairs.iter().map(|(_, from, to)| {
        let [from, to] = [from, to].map(|level| f64::from(linear_from_srgb(*level as f32)));
        (to / from).log2()
    });
    let count = pairs.len().max(1) as f64;
    let exposure = (stops.sum::<f64>() / count).exp2();
    let (contrast, offset) = line(pairs);
    let line = Curve::Line {
        slope: contrast,
        offset,
    };
    let curves = [
        Curve::AS_READ,
        Curve::Reinhard,
        power(1.0, [factor.exp(); 3]),
        Curve::Exposure(exposure),
        power(slope([[0.0; 2]; 3]), [1.0; 3]),
        line,
        power(1.0, gains(1.0)),
        power(own, gains(own)),
    ];
    let before = error(pairs, Curve::AS_READ);
    let off = (before / count).sqrt();
    // A method that blurs or hedges loses contrast, but keeps the mean. A line, or a power below 1, describes this.
    let shift = pairs.iter().map(|(_, from, to)| to - from).sum::<f64>() / count;
    let is_shifted = shift.abs() >= MIN_MEAN_SHARE * off;
    let off_line = error(pairs, line);
    let is_told = |curve: &Curve| match curve {
        Curve::Power { gamma, .. } if *gamma != 1.0 => {
            is_shifted || *gamma > 1.0 && error(pairs, *curve) <= MAX_BETTER_ERROR * off_line
        }
        Curve::Line { .. } => is_shifted,
        Curve::Cubic(_) => {
            let error = error(pairs, *curve);
            let is_close = 255.0 * (error / count).sqrt() <= MAX_OFF_CUBIC;
            is_close && (contrast >= MIN_RAISED_CONTRAST || error <= MAX_CUBIC_ERROR * off_line)
        }
        _ => true,
    };
    let curves = curves.into_iter().chain(Curve::cubic(pairs));
    let best = curves.filter(is_told).reduce(|best, curve| {
        if error(pairs, curve) < MAX_BETTER_ERROR * error(pairs, best) {
            curve
        } else {
            best
        }
    })?;
    (255.0 * off >= min_off && error(pairs, best) <= MAX_EXPLAINED_ERROR * before).then_some(best)
}

/// Number of the pictures in `of` whose levels `curve` explains.
pub(super) fn explained(of: &[Vec<LevelPair>], curve: Curve) -> usize {
    let is_explained =
        |pairs: &&Vec<LevelPair>| 2.0 * error(pairs, curve) <= error(pairs, Curve::AS_READ);
    of.iter().filter(is_explained).count()
}
