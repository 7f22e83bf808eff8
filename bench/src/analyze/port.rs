//! Compares a port of SHARP with the release or with this implementation: two predictions from the
//! same photograph, Gaussian by Gaussian.

use std::collections::HashMap;

use glam::{DAffine3, DMat3, DVec3};
use serde::Serialize;
use sharp::camera::{Intrinsics, RigidTransform};
use sharp::color::srgb_from_linear;
use sharp::gaussians::Gaussians;
use sharp::ply::{
    ColorSpace, StoredChannels, StoredColors, StoredForm, StoredOpacity, StoredQuaternions,
    StoredScales,
};
use sharp::unprojection::covariance;

use crate::methods::file_reading::{Axes, FileReading, FileSpace, Placement};
use crate::pairs::PosedCamera;

/// Approximate number of Gaussians for testing an interpretation of the port's file, evenly spread over the file.
const SAMPLE: usize = 4096;
/// Gaussians count as matched if their median distance, as computed by [`Pair::distance`], is below this value, in
/// pixels.
const SAME_PLACE: f64 = 2.0;
/// Factor by which one number must exceed another to count as clearly larger. Used to compare an
/// attribute's median difference under two interpretations of the file, and the size of a common
/// shift with its spread.
const MUCH_LESS: f64 = 10.0;
/// Median differences of an attribute up to this value, in per cent, count as agreement; no other interpretation of the
/// attribute is chosen then.
const NEGLIGIBLE: f64 = 0.1;
/// A common shift of all Gaussians is reported as a cause of differences only if it has at least this size, in pixels.
const MIN_SHIFT: f64 = 0.05;
/// Side of a cell of the neighbour search, in pixels.
const CELL: f64 = 4.0;
/// Converts a relative difference in depth to pixels: 1 % of depth counts as one pixel.
const PIXELS_OF_DEPTH: f64 = 100.0;

/// Differences in one attribute.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FieldDifference {
    pub field: &'static str,
    pub unit: &'static str,
    pub median: f64,
    pub p99: f64,
    pub largest: f64,
}

#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PortComparison {
    /// How the Gaussians in the port's file are ordered relative to the reference's.
    pub order: &'static str,
    /// Number of the port's Gaussians minus the number of the reference's Gaussians that have a counterpart.
    pub extra: usize,
    /// Number of the reference's Gaussians without a counterpart in the port.
    pub missing: usize,
    /// Number of the port's Gaussians with a non-finite value.
    pub not_finite: usize,
    /// Differences if the port's file is read with the settings given by the user.
    pub as_read: Vec<FieldDifference>,
    /// Changes to the given settings that explain most of the differences.
    pub settings: Vec<(&'static str, String)>,
    /// Differences that remain after the changes in `settings`; empty if there are no changes.
    pub with_settings: Vec<FieldDifference>,
}

/// Names and units of the differences, in the order of `Pair::values`: distance between the means as projected into
/// the photograph, relative difference of depth, relative Frobenius norm of the covariances' difference, difference of
/// opacity, and the largest difference among the sRGB channels.
const FIELDS: [(&str, &str); 5] = [
    ("position", "px"),
    ("depth", "%"),
    ("covariance", "%"),
    ("opacity", "% of 1"),
    ("colour", "% of sRGB"),
];
/// Index of the covariance in [`FIELDS`].
const COVARIANCE: usize = 2;
/// Index of the opacity in [`FIELDS`].
const OPACITY: usize = 3;
/// Index of the colour in [`FIELDS`].
const COLOUR: usize = 4;

/// Orders of a port's file. Each maps the index `i` of `n` Gaussians, in two layers of `side` rows,
/// to the index in the reference.
type Order = (&'static str, fn(usize, usize, usize) -> usize);
const ORDERS: [Order; 6] = [
    ("the same order", |i, _, _| i),
    ("an order with its two layers swapped", |i, n, _| {
        (i + n / 2) % n
    }),
    (
        "an order with both layers of a pixel side by side",
        |i, n, _| i % 2 * (n / 2) + i / 2,
    ),
    ("an order with columns before rows", |i, _, side| {
        in_layer(i, side, |row, column| (column, row))
    }),
    ("an order with rows from the bottom", |i, _, side| {
        in_layer(i, side, |row, column| (side - 1 - row, column))
    }),
    ("an order with columns from the right", |i, _, side| {
        in_layer(i, side, |row, column| (row, side - 1 - column))
    }),
];

fn in_layer(i: usize, side: usize, map: impl Fn(usize, usize) -> (usize, usize)) -> usize {
    let (layer, rest) = (i / (side * side), i % (side * side));
    let (row, column) = map(rest / side, rest % side);
    (layer * side + row) * side + column
}

/// Compares a port's Gaussians with the reference's. Both sets of Gaussians must have linear
/// colours and be in the camera space of the photograph. `stored` is the form in which the port's
/// file was read.
pub fn compare(
    port: &Gaussians,
    stored: StoredForm,
    reference: &Gaussians,
    intrinsics: Intrinsics,
) -> PortComparison {
    let pair = Pair {
        port,
        stored,
        reference,
        camera: PosedCamera {
            id: String::new(),
            intrinsics,
            camera_from_world: RigidTransform::IDENTITY,
        },
    };
    let (mut placement, order, matches) = pair.matched();
    let as_read = FileReading {
        stored,
        ..FileReading::default()
    };
    if let Some(scale) = pair.scale(&placement, &matches) {
        placement.scale *= scale;
    }
    placement.shift = pair.shift(&placement, &matches);
    let mut better = FileReading {
        placement,
        ..as_read
    };
    let sample: Vec<[u32; 2]> = spread(&matches).collect();
    for field in [COVARIANCE, OPACITY, COLOUR] {
        let median = |reading: &FileReading| pair.medians(reading, &sample)[field];
        let own = median(&better);
        let others = forms(field, better.stored).into_iter().map(|stored| {
            let other = FileReading { stored, ..better };
            (median(&other), other)
        });
        let least = others.min_by(|a, b| a.0.total_cmp(&b.0));
        if let Some((found, other)) = least
            && own > NEGLIGIBLE
            && found * MUCH_LESS < own
        {
            better = other;
        }
    }
    let settings = better.changes_from(&as_read);
    let with_settings = if settings.is_empty() {
        Vec::new()
    } else {
        pair.differences(&better, &matches)
    };
    let mut is_found = vec![false; reference.len()];
    for [_, other] in &matches {
        is_found[*other as usize] = true;
    }
    let found = is_found.iter().filter(|found| **found).count();
    PortComparison {
        order,
        extra: port.len() - found,
        missing: reference.len() - found,
        not_finite: (0..port.len()).filter(|k| !port.is_finite(*k)).count(),
        as_read: pair.differences(&as_read, &matches),
        settings,
        with_settings,
    }
}

struct Pair<'a> {
    port: &'a Gaussians,
    stored: StoredForm,
    reference: &'a Gaussians,
    camera: PosedCamera,
}

impl Pair<'_> {
    /// Placement and order of the port's Gaussians, and the matched pairs of indices.
    ///
    /// If port and reference have equally many Gaussians, the known orders are tried, and the order with the smallest
    /// median distance between matched Gaussians is taken. This distance must be below [`SAME_PLACE`], unless opacities
    /// or colours show that the order is the reference's. Otherwise, Gaussians are matched by position, with the
    /// placement that gives the most matches.
    fn matched(&self) -> (Placement, &'static str, Vec<[u32; 2]>) {
        let n = self.port.len();
        let placements = || {
            // OpenCV's axes are tried first, because ties go to the first.
            let axes = [Axes::OPENCV]
                .into_iter()
                .chain(Axes::every())
                .map(|axes| Placement {
                    axes,
                    ..Placement::default()
                });
            axes.chain([Placement {
                space: FileSpace::Normalized,
                ..Placement::default()
            }])
        };
        let in_order: Vec<[u32; 2]> = (0..n as u32).map(|k| [k, k]).collect();
        let is_in_order = n == self.reference.len() && self.is_same_order(&in_order);
        let side = (n / 2).isqrt();
        let is_grid = 2 * side * side == n;
        let orders = ORDERS.iter().enumerate();
        let orders = orders
            .filter(|(k, _)| n == self.reference.len() && (*k == 0 || is_grid && !is_in_order));
        let mut best: Option<(f64, Placement, usize)> = None;
        for (k, (_, place)) in orders {
            let pairs: Vec<[u32; 2]> = (0..n)
                .map(|i| [i as u32, place(i, n, side) as u32])
                .collect();
            let sample: Vec<[u32; 2]> = spread(&pairs).collect();
            for placement in placements() {
                let distance = self.distance(&placement, &sample);
                if best.is_none_or(|(least, ..)| distance < least) {
                    best = Some((distance, placement, k));
                }
            }
        }
        if let Some((distance, placement, k)) = best
            && (distance < SAME_PLACE || is_in_order)
        {
            let (name, place) = ORDERS[k];
            let pairs = (0..n).map(|i| [i as u32, place(i, n, side) as u32]);
            return (placement, name, pairs.collect());
        }
        let cells = Cells::of(self.reference, &self.camera.intrinsics);
        let some: Vec<u32> = (0..n as u32).step_by((n / SAMPLE).max(1)).collect();
        let depth = |gaussians: &Gaussians, map: DAffine3| {
            median((0..gaussians.len() as u32).map(|k| map.transform_point3(mean(gaussians, k)).z))
        };
        let true_depth = depth(self.reference, DAffine3::IDENTITY);
        // Try the reference's unit, and the unit that the ratio of median depths suggests.
        let scaled = placements().map(|placement| {
            let ratio = true_depth / depth(self.port, placement.camera_from_file(&self.camera));
            let scale = Some(ratio).filter(|ratio| ratio.is_finite() && *ratio > 0.0);
            Placement {
                scale: scale.unwrap_or(1.0),
                ..placement
            }
        });
        let found = placements().chain(scaled).map(|placement| {
            let map = placement.camera_from_file(&self.camera);
            let near = cells.nearest(self.port, &map, some.iter().copied());
            (near.len(), placement)
        });
        let (_, placement) = found
            .reduce(|best, other| {
                if other.0 > best.0 + best.0 / 10 {
                    other
                } else {
                    best
                }
            })
            .unwrap_or_default();
        let map = placement.camera_from_file(&self.camera);
        let pairs = cells.nearest(self.port, &map, 0..n as u32);
        (placement, "another order, matched by position", pairs)
    }

    /// Median distance of the means in pixels; a difference in depth adds a small amount.
    fn distance(&self, placement: &Placement, sample: &[[u32; 2]]) -> f64 {
        let map = placement.camera_from_file(&self.camera);
        let k = &self.camera.intrinsics;
        median(sample.iter().map(|[i, j]| {
            let own = map.transform_point3(mean(self.port, *i));
            apart(k, own, mean(self.reference, *j)).map_or(f64::MAX, |[pixels, depth]| {
                // A small weight on depth, so that the unit of depth does not determine the choice of axes.
                pixels + depth.min(1.0) * 1e-3
            })
        }))
    }

    /// Whether opacities or colours show that Gaussians of the same index correspond, even if their positions differ.
    fn is_same_order(&self, in_order: &[[u32; 2]]) -> bool {
        let sample: Vec<[u32; 2]> = spread(in_order).collect();
        let reading = FileReading {
            stored: self.stored,
            ..FileReading::default()
        };
        let medians = self.medians(&reading, &sample);
        medians[OPACITY] < NEGLIGIBLE || medians[COLOUR] < NEGLIGIBLE
    }

    /// The shift, in pixels (right, down), that moves the port's Gaussians onto the reference's in
    /// the camera's picture. A component is zero if its value is too small or varies across the
    /// Gaussians.
    fn shift(&self, placement: &Placement, matches: &[[u32; 2]]) -> [f64; 2] {
        let map = placement.camera_from_file(&self.camera);
        let focal = [self.camera.intrinsics.fx, self.camera.intrinsics.fy];
        let seen = |axis: usize, p: DVec3| focal[axis] * p[axis] / p.z;
        let by = |axis: usize| -> Vec<f64> {
            let each = spread(matches).map(|[i, j]| {
                let own = map.transform_point3(mean(self.port, i));
                seen(axis, mean(self.reference, j)) - seen(axis, own)
            });
            each.filter(|by| by.is_finite()).collect()
        };
        [0, 1].map(|axis| {
            let all = by(axis);
            let middle = median(all.iter().copied());
            let around = median(all.iter().map(|by| (by - middle).abs()));
            let is_one = middle.abs() > MIN_SHIFT && around * MUCH_LESS < middle.abs();
            if is_one {
                (middle * 1000.0).round() / 1000.0
            } else {
                0.0
            }
        })
    }

    /// The unit of the port's means in metres; `None` if the unit is a metre.
    fn scale(&self, placement: &Placement, matches: &[[u32; 2]]) -> Option<f64> {
        let map = placement.camera_from_file(&self.camera);
        let ratio = median(spread(matches).map(|[i, j]| {
            let own = map.transform_point3(mean(self.port, i));
            mean(self.reference, j).length() / own.length()
        }));
        let rounded = format!("{ratio:.3e}").parse().ok();
        rounded.filter(|_| ratio.is_finite() && (ratio - 1.0).abs() > 0.01)
    }

    fn medians(&self, reading: &FileReading, sample: &[[u32; 2]]) -> [f64; 5] {
        self.values(reading, sample)
            .map(|values| median(values.into_iter()))
    }

    fn differences(&self, reading: &FileReading, matches: &[[u32; 2]]) -> Vec<FieldDifference> {
        let values = self.values(reading, matches).into_iter().zip(FIELDS);
        values
            .map(|(mut values, (field, unit))| {
                values.sort_by(f64::total_cmp);
                let at = |q: f64| {
                    let place = (values.len().saturating_sub(1) as f64 * q).round() as usize;
                    values.get(place).copied().unwrap_or(f64::NAN)
                };
                FieldDifference {
                    field,
                    unit,
                    median: at(0.5),
                    p99: at(0.99),
                    largest: at(1.0),
                }
            })
            .collect()
    }

    /// Differences of each attribute in [`FIELDS`], one value per matched pair.
    fn values(&self, reading: &FileReading, matches: &[[u32; 2]]) -> [Vec<f64>; 5] {
        let members: Vec<usize> = matches.iter().map(|[i, _]| *i as usize).collect();
        let mut own = self.port.subset(&members);
        if reading.stored != self.stored {
            self.stored.encode(&mut own);
            reading.stored.decode(&mut own);
        }
        let map = reading.placement.camera_from_file(&self.camera);
        let k = &self.camera.intrinsics;
        let mut values: [Vec<f64>; 5] = Default::default();
        for (i, [_, j]) in matches.iter().enumerate() {
            let j = *j as usize;
            let place = map.transform_point3(mean(&own, i as u32));
            let [pixels, depth] =
                apart(k, place, mean(self.reference, j as u32)).unwrap_or([f64::INFINITY; 2]);
            let [a, b] = [(&own, i), (self.reference, j)]
                .map(|(g, k)| covariance(g.quaternions[k], g.scales[k]).as_dmat3());
            let a = map.matrix3 * a * map.matrix3.transpose();
            let opacity = f64::from((own.opacities[i] - self.reference.opacities[j]).abs());
            let channel =
                |g: &Gaussians, k: usize, c: usize| f64::from(srgb_from_linear(g.colors[k][c]));
            let color = (0..3).map(|c| (channel(&own, i, c) - channel(self.reference, j, c)).abs());
            let color = color.fold(0.0, f64::max);
            let all = [
                pixels,
                100.0 * depth,
                100.0 * norm(a - b) / norm(b).max(f64::MIN_POSITIVE),
                100.0 * opacity,
                100.0 * color,
            ];
            for (values, value) in values.iter_mut().zip(all) {
                values.push(value);
            }
        }
        values
    }
}

/// Distance in pixels and relative distance in depth; `None` if either point is behind the camera.
fn apart(k: &Intrinsics, own: DVec3, other: DVec3) -> Option<[f64; 2]> {
    let seen = |p: DVec3| [k.fx * p.x / p.z, k.fy * p.y / p.z];
    let [[x, y], [u, v]] = [seen(own), seen(other)];
    let depth = (own.z / other.z - 1.0).abs();
    (own.z > 0.0 && other.z > 0.0).then(|| [(x - u).hypot(y - v), depth])
}

fn mean(gaussians: &Gaussians, k: u32) -> DVec3 {
    DVec3::from(gaussians.means[k as usize].map(f64::from))
}

fn norm(m: DMat3) -> f64 {
    m.to_cols_array().iter().map(|v| v * v).sum::<f64>().sqrt()
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    let middle = values.len() / 2;
    if values.is_empty() {
        f64::NAN
    } else {
        *values.select_nth_unstable_by(middle, f64::total_cmp).1
    }
}

fn spread(matches: &[[u32; 2]]) -> impl Iterator<Item = [u32; 2]> {
    matches
        .iter()
        .copied()
        .step_by((matches.len() / SAMPLE).max(1))
}

/// All forms in which attribute `field` may be stored; all other attributes keep their form in `current`.
fn forms(field: usize, current: StoredForm) -> Vec<StoredForm> {
    let mut all = Vec::new();
    match field {
        COVARIANCE => {
            for scales in StoredScales::ALL {
                all.extend(StoredQuaternions::ALL.iter().map(|quaternions| StoredForm {
                    scales: Some(*scales),
                    quaternions: Some(*quaternions),
                    ..current
                }));
            }
        }
        OPACITY => all.extend(StoredOpacity::ALL.iter().map(|opacity| StoredForm {
            opacity: Some(*opacity),
            ..current
        })),
        _ => {
            for colors in StoredColors::ALL {
                for color_space in ColorSpace::ALL {
                    all.extend(StoredChannels::ALL.iter().map(|channels| StoredForm {
                        colors: Some(*colors),
                        color_space: Some(*color_space),
                        channels: Some(*channels),
                        ..current
                    }));
                }
            }
        }
    }
    all
}

/// A grid of Gaussians by the pixel position of their centres.
struct Cells<'a> {
    reference: &'a Gaussians,
    k: Intrinsics,
    members: HashMap<[i32; 2], Vec<u32>>,
}

impl<'a> Cells<'a> {
    fn of(reference: &'a Gaussians, k: &Intrinsics) -> Self {
        let mut cells = Self {
            reference,
            k: *k,
            members: HashMap::new(),
        };
        for index in 0..reference.len() as u32 {
            if let Some(cell) = cells.cell(mean(reference, index)) {
                cells.members.entry(cell).or_default().push(index);
            }
        }
        cells
    }

    fn cell(&self, p: DVec3) -> Option<[i32; 2]> {
        let at = |f: f64, v: f64| (f * v / p.z / CELL).floor() as i32;
        (p.z > 0.0).then(|| [at(self.k.fx, p.x), at(self.k.fy, p.y)])
    }

    /// Pairs each of the port's Gaussians with the nearest Gaussian of the reference; skips Gaussians with none nearby.
    fn nearest(
        &self,
        port: &Gaussians,
        map: &DAffine3,
        indices: impl Iterator<Item = u32>,
    ) -> Vec<[u32; 2]> {
        let found = indices.filter_map(|index| {
            let own = map.transform_point3(mean(port, index));
            let [x, y] = self.cell(own)?;
            let around = (-1..=1).flat_map(|dx| (-1..=1).map(move |dy| [x + dx, y + dy]));
            let near = around.filter_map(|cell| self.members.get(&cell)).flatten();
            let near = near.filter_map(|&other| {
                let [pixels, depth] = apart(&self.k, own, mean(self.reference, other))?;
                let distance = pixels.hypot(PIXELS_OF_DEPTH * depth);
                (distance < SAME_PLACE).then_some((distance, other))
            });
            let (_, other) = near.min_by(|a, b| a.0.total_cmp(&b.0))?;
            Some([index, other])
        });
        found.collect()
    }
}
