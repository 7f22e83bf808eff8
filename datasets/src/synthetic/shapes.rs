//! Rectangles, boxes, spheres and cylinders, and their intersections with rays.

use glam::{DMat3, DVec3};

/// A surface that rays can hit.
#[derive(Debug, Clone)]
pub(super) enum SurfaceShape {
    /// A flat two-sided rectangle. `axes` are the directions of its two half edges and its normal, orthonormal.
    Rectangle {
        center: DVec3,
        axes: DMat3,
        half: (f64, f64),
    },
    /// A solid box with orthonormal `axes`.
    Box {
        center: DVec3,
        axes: DMat3,
        half: DVec3,
    },
    Sphere {
        center: DVec3,
        radius: f64,
    },
    /// A solid cylinder along the second of its orthonormal `axes`; it extends by `half` to both sides of the centre.
    Cylinder {
        center: DVec3,
        axes: DMat3,
        radius: f64,
        half: f64,
    },
}

/// Intersection of a ray with a shape.
#[derive(Debug, Clone, Copy)]
pub(super) struct Meeting {
    /// Distance in units of the ray's direction vector, > 0.
    pub(super) distance: f64,
    /// Unit normal, facing the ray's origin.
    pub(super) normal: DVec3,
    /// The point in the shape's own axes, in metres from its centre.
    pub(super) local: DVec3,
    /// Index of the local axis perpendicular to the surface; textures use the other two axes. 3 if
    /// the surface is curved.
    pub(super) across: usize,
}

impl SurfaceShape {
    /// Bounding sphere: its centre and squared radius, slightly enlarged so that rounding cannot cut anything off.
    pub(super) fn bounds(&self) -> (DVec3, f64) {
        let (center, square) = match self {
            Self::Rectangle { center, half, .. } => (*center, half.0 * half.0 + half.1 * half.1),
            Self::Box { center, half, .. } => (*center, half.dot(*half)),
            Self::Sphere { center, radius } => (*center, radius * radius),
            Self::Cylinder {
                center,
                radius,
                half,
                ..
            } => (*center, radius * radius + half * half),
        };
        (center, square * 1.000_001)
    }

    /// The first intersection in front of the origin, if any.
    pub(super) fn meet(&self, origin: DVec3, direction: DVec3) -> Option<Meeting> {
        match self {
            Self::Rectangle { center, axes, half } => {
                let (o, d) = local(axes, origin - *center, direction);
                let distance = -o.z / d.z;
                let point = o + d * distance;
                let inside = point.x.abs() <= half.0 && point.y.abs() <= half.1;
                (distance > 0.0 && inside).then(|| Meeting {
                    distance,
                    normal: axes.z_axis * -d.z.signum(),
                    local: point,
                    across: 2,
                })
            }
            Self::Box { center, axes, half } => {
                let (o, d) = local(axes, origin - *center, direction);
                // The ray is inside the box between the last entry into and the first exit from the three slabs.
                let (mut enter, mut leave, mut across) = (f64::NEG_INFINITY, f64::INFINITY, 0);
                for axis in 0..3 {
                    let (p, q) = (
                        (-half[axis] - o[axis]) / d[axis],
                        (half[axis] - o[axis]) / d[axis],
                    );
                    let (near, far) = if p < q { (p, q) } else { (q, p) };
                    if near > enter {
                        (enter, across) = (near, axis);
                    }
                    if far < leave {
                        leave = far;
                    }
                }
                (enter > 0.0 && enter <= leave).then(|| Meeting {
                    distance: enter,
                    normal: axes.col(across) * -d[across].signum(),
                    local: o + d * enter,
                    across,
                })
            }
            Self::Sphere { center, radius } => {
                let o = origin - *center;
                let a = direction.dot(direction);
                let b = o.dot(direction);
                let c = o.dot(o) - radius * radius;
                let discriminant = b * b - a * c;
                if discriminant < 0.0 {
                    return None;
                }
                let distance = (-b - discriminant.sqrt()) / a;
                (distance > 0.0).then(|| {
                    let local = o + direction * distance;
                    Meeting {
                        distance,
                        normal: local / *radius,
                        local,
                        across: 3,
                    }
                })
            }
            Self::Cylinder {
                center,
                axes,
                radius,
                half,
            } => {
                let (o, d) = local(axes, origin - *center, direction);
                // The ray is inside between the last entry into and the first exit from the infinite cylinder and the
                // slab between its ends.
                let a = d.x * d.x + d.z * d.z;
                let b = o.x * d.x + o.z * d.z;
                let c = o.x * o.x + o.z * o.z - radius * radius;
                let discriminant = b * b - a * c;
                if discriminant < 0.0 || (a == 0.0 && c > 0.0) {
                    return None;
                }
                let root = discriminant.sqrt();
                let column = if a > 0.0 {
                    ((-b - root) / a, (-b + root) / a)
                } else {
                    (f64::NEG_INFINITY, f64::INFINITY)
                };
                let (p, q) = ((-half - o.y) / d.y, (half - o.y) / d.y);
                let slab = if p < q { (p, q) } else { (q, p) };
                let curved = column.0 > slab.0;
                let enter = if curved { column.0 } else { slab.0 };
                if !(enter > 0.0 && enter <= column.1 && enter <= slab.1) {
                    return None;
                }
                let point = o + d * enter;
                Some(Meeting {
                    distance: enter,
                    normal: if curved {
                        *axes * DVec3::new(point.x / radius, 0.0, point.z / radius)
                    } else {
                        axes.y_axis * -d.y.signum()
                    },
                    local: point,
                    across: if curved { 3 } else { 1 },
                })
            }
        }
    }

    /// Extent of the shape along a direction: the maximum dot product of `direction` with any of its points.
    pub(super) fn reach(&self, direction: DVec3) -> f64 {
        match self {
            Self::Rectangle { center, axes, half } => {
                center.dot(direction)
                    + half.0 * axes.x_axis.dot(direction).abs()
                    + half.1 * axes.y_axis.dot(direction).abs()
            }
            Self::Box { center, axes, half } => {
                let along = axes.transpose() * direction;
                center.dot(direction) + half.dot(along.abs())
            }
            Self::Sphere { center, radius } => center.dot(direction) + radius * direction.length(),
            Self::Cylinder {
                center,
                axes,
                radius,
                half,
            } => {
                let along = axes.transpose() * direction;
                let round = (along.x * along.x + along.z * along.z).sqrt();
                center.dot(direction) + half * along.y.abs() + radius * round
            }
        }
    }

    /// Distance in metres from a point to the shape; 0 inside.
    pub(super) fn distance_to(&self, point: DVec3) -> f64 {
        match self {
            Self::Rectangle { center, axes, half } => {
                let p = axes.transpose() * (point - *center);
                let edge = DVec3::new(half.0, half.1, 0.0);
                (p.abs() - edge).max(DVec3::ZERO).length()
            }
            Self::Box { center, axes, half } => {
                let p = axes.transpose() * (point - *center);
                (p.abs() - *half).max(DVec3::ZERO).length()
            }
            Self::Sphere { center, radius } => ((point - *center).length() - radius).max(0.0),
            Self::Cylinder {
                center,
                axes,
                radius,
                half,
            } => {
                let p = axes.transpose() * (point - *center);
                let beside = ((p.x * p.x + p.z * p.z).sqrt() - radius).max(0.0);
                let beyond = (p.y.abs() - half).max(0.0);
                (beside * beside + beyond * beyond).sqrt()
            }
        }
    }

    /// The shape rotated about the origin.
    pub(super) fn turned_by(self, turn: &DMat3) -> Self {
        match self {
            Self::Rectangle { center, axes, half } => Self::Rectangle {
                center: *turn * center,
                axes: *turn * axes,
                half,
            },
            Self::Box { center, axes, half } => Self::Box {
                center: *turn * center,
                axes: *turn * axes,
                half,
            },
            Self::Sphere { center, radius } => Self::Sphere {
                center: *turn * center,
                radius,
            },
            Self::Cylinder {
                center,
                axes,
                radius,
                half,
            } => Self::Cylinder {
                center: *turn * center,
                axes: *turn * axes,
                radius,
                half,
            },
        }
    }
}

/// A ray in a shape's own axes.
fn local(axes: &DMat3, origin: DVec3, direction: DVec3) -> (DVec3, DVec3) {
    let turn = axes.transpose();
    (turn * origin, turn * direction)
}

/// Orthonormal axes rotated by the quaternion (x, y, z, w), which need not be normalised.
pub(super) fn turned(x: f64, y: f64, z: f64, w: f64) -> DMat3 {
    let s = 1.0 / (x * x + y * y + z * z + w * w).sqrt();
    let (x, y, z, w) = (x * s, y * s, z * s, w * s);
    DMat3::from_cols(
        DVec3::new(
            1.0 - 2.0 * (y * y + z * z),
            2.0 * (x * y + w * z),
            2.0 * (x * z - w * y),
        ),
        DVec3::new(
            2.0 * (x * y - w * z),
            1.0 - 2.0 * (x * x + z * z),
            2.0 * (y * z + w * x),
        ),
        DVec3::new(
            2.0 * (x * z + w * y),
            2.0 * (y * z - w * x),
            1.0 - 2.0 * (x * x + y * y),
        ),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_meet_shapes_where_geometry_says() {
        let axes = turned(0.0, 0.0, 0.0, 2.0);
        assert_eq!(axes, DMat3::IDENTITY);
        let center = DVec3::new(0.0, 0.0, 5.0);
        let forward = DVec3::new(0.0, 0.0, 2.0);
        let rectangle = SurfaceShape::Rectangle {
            center,
            axes,
            half: (1.0, 1.0),
        };
        let cube = SurfaceShape::Box {
            center,
            axes,
            half: DVec3::splat(1.0),
        };
        let ball = SurfaceShape::Sphere {
            center,
            radius: 1.0,
        };
        let drum = SurfaceShape::Cylinder {
            center,
            axes: turned(1.0, 0.0, 0.0, 1.0),
            radius: 1.0,
            half: 1.0,
        };
        let column = SurfaceShape::Cylinder {
            center,
            axes,
            radius: 1.0,
            half: 0.5,
        };
        for (shape, distance) in [
            (&rectangle, 2.5),
            (&cube, 2.0),
            (&ball, 2.0),
            (&drum, 2.0),
            (&column, 2.0),
        ] {
            let meeting = shape.meet(DVec3::ZERO, forward).unwrap();
            assert!((meeting.distance - distance).abs() < 1e-12);
            assert!((meeting.normal - DVec3::NEG_Z).length() < 1e-12);
            assert!(shape.meet(DVec3::ZERO, -forward).is_none());
            assert!(shape.meet(DVec3::new(1.5, 0.0, 0.0), forward).is_none());
        }
        // From the side, at an angle.
        let meeting = cube
            .meet(DVec3::new(-3.0, 0.5, 5.0), DVec3::new(1.0, 0.0, 0.0))
            .unwrap();
        assert_eq!((meeting.distance, meeting.across), (2.0, 0));
    }

    #[test]
    fn turned_axes_are_orthonormal() {
        let m = turned(0.3, -0.2, 0.9, 0.4);
        let deviation = m * m.transpose() - DMat3::IDENTITY;
        assert!(deviation.to_cols_array().iter().all(|v| v.abs() < 1e-15));
        assert!((m.determinant() - 1.0).abs() < 1e-15);
    }

    #[test]
    fn reach_and_distance_enclose_what_rays_meet() {
        let axes = turned(0.2, -0.5, 0.3, 1.0);
        let center = DVec3::new(0.3, -0.2, 4.0);
        let shapes = [
            SurfaceShape::Rectangle {
                center,
                axes,
                half: (1.0, 0.6),
            },
            SurfaceShape::Box {
                center,
                axes,
                half: DVec3::new(0.9, 0.5, 0.7),
            },
            SurfaceShape::Sphere {
                center,
                radius: 0.8,
            },
            SurfaceShape::Cylinder {
                center,
                axes,
                radius: 0.4,
                half: 1.1,
            },
        ];
        for shape in &shapes {
            let (ball, square_radius) = shape.bounds();
            let mut farthest = f64::NEG_INFINITY;
            let aim = DVec3::new(0.6, 0.64, 0.48);
            for i in 0..200 * 200 {
                let (x, y) = (f64::from(i % 200) - 99.5, f64::from(i / 200) - 99.5);
                let direction = DVec3::new(x / 250.0, y / 250.0, 1.0);
                let Some(meeting) = shape.meet(DVec3::ZERO, direction) else {
                    continue;
                };
                let point = direction * meeting.distance;
                assert!(shape.distance_to(point) < 1e-9);
                // A step back along the ray is outside the shape, and no farther from it than the
                // step.
                let back = point - direction * 0.05;
                let away = shape.distance_to(back);
                assert!(away > 0.0 && away <= 0.05 * direction.length() + 1e-9);
                assert!((point - ball).length_squared() <= square_radius);
                assert!(meeting.normal.dot(direction) < 1e-9);
                assert!((meeting.normal.length() - 1.0).abs() < 1e-9);
                farthest = farthest.max(point.dot(aim));
            }
            assert!(farthest <= shape.reach(aim) + 1e-9);
            assert!(shape.reach(aim) - farthest < 1.5);
        }
    }
}
