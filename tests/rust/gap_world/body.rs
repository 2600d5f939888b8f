//! The body: where its parts are when play, friction, springs and wrong measures have had their say.

use super::{GRAVITY, PLAY_STEPS, Plan, World, Wrong};
use nalgebra::{Isometry3, Point3, Translation3, Unit, UnitQuaternion, Vector3};
use rand::Rng;
use rand_chacha::ChaCha8Rng;

/// Pieces of a beam, each with a hinge in its middle.
const BEAM_PIECES: usize = 8;

/// Where the middle of a piece is, as a share of the whole.
fn middle_of(piece: usize, pieces: usize) -> f64 {
    (piece as f64 + 0.5) / pieces as f64
}

impl World {
    fn below(&self, bone: usize, ancestor: usize) -> bool {
        let mut at = Some(bone);
        while let Some(b) = at {
            if b == ancestor {
                return true;
            }
            at = self.bones[b].parent;
        }
        false
    }

    /// What a bone carries next: the next joint's origin, or its farthest marker.
    fn tip(&self, bone: usize) -> Vector3<f64> {
        let child = self.bones.iter().find(|b| b.parent == Some(bone)).map(|b| b.at);
        let far = self.markers.iter().filter(|m| m.1 == bone).map(|m| m.2);
        child.or(far.max_by(|a, b| a.norm().total_cmp(&b.norm()))).unwrap_or_else(Vector3::zeros)
    }

    /// Poses of the bones' frames in the base at actual joint positions.
    fn chain(&self, theta: &[f64], wrong: &[Wrong], bends: &[Vec<Vector3<f64>>]) -> Vec<Isometry3<f64>> {
        let mut out: Vec<Isometry3<f64>> = Vec::new();
        for (b, bone) in self.bones.iter().enumerate() {
            let (mut at, mut axis) = (bone.at, bone.axis);
            for w in wrong {
                match w {
                    Wrong::Length(link, d) if *link == bone.parent => at += Vector3::from(*d),
                    Wrong::Tilt(joint, t1, t2) if *joint == b => {
                        let e = if axis.x.abs() >= 0.8 { Vector3::y() } else { Vector3::x() };
                        let u = axis.cross(&e).normalize();
                        let v = axis.cross(&u);
                        axis = (axis + u * t1.tan() + v * t2.tan()).normalize();
                    }
                    _ => {}
                }
            }
            let turn = UnitQuaternion::from_axis_angle(&Unit::new_normalize(axis), theta[b]);
            let mut pose = bone.parent.map_or_else(Isometry3::identity, |p| out[p])
                * Isometry3::from_parts(Translation3::from(at), turn);
            for (piece, bend) in bends[b].iter().enumerate() {
                let hinge = Translation3::from(self.tip(b) * middle_of(piece, bends[b].len()));
                pose = pose * hinge * UnitQuaternion::from_scaled_axis(*bend) * hinge.inverse();
            }
            out.push(pose);
        }
        out
    }

    /// Torque of gravity about a point of all that a bone carries, itself included.
    fn load_about(&self, bone: usize, poses: &[Isometry3<f64>], at: &Point3<f64>) -> Vector3<f64> {
        (0..self.bones.len())
            .filter(|&b| self.below(b, bone))
            .map(|b| {
                let lever = poses[b] * Point3::from(self.bones[b].com) - at;
                lever.cross(&(GRAVITY * self.bones[b].mass))
            })
            .sum()
    }

    /// The moment of gravity at a place of a bone, a share of the way to its tip, in its frame: of what it carries, and of its own mass,
    /// spread evenly around its centre, as far as that lies beyond.
    fn load_beyond(&self, bone: usize, poses: &[Isometry3<f64>], share: f64) -> Vector3<f64> {
        let (own, tip) = (&self.bones[bone], self.tip(bone));
        let place = tip * share;
        let at = poses[bone] * Point3::from(place);
        let whole = self.load_about(bone, poses, &at);
        let down = poses[bone].rotation.inverse() * GRAVITY;
        let part = |way: f64| (own.com * (2.0 * way) - place, down * (own.mass / BEAM_PIECES as f64));
        let lumped = (own.com - place).cross(&(down * own.mass));
        let beyond: Vector3<f64> = (0..BEAM_PIECES)
            .map(|piece| part(middle_of(piece, BEAM_PIECES)))
            .filter(|(lever, _)| lever.dot(&tip) > 0.0)
            .map(|(lever, weight)| lever.cross(&weight))
            .sum();
        poses[bone].rotation.inverse() * whole - lumped + beyond
    }

    /// Moment of gravity of all bones about the base's origin.
    pub(super) fn moment_about_base(&self, poses: &[Isometry3<f64>]) -> Vector3<f64> {
        let of = |(bone, pose): (&super::Bone, &Isometry3<f64>)| {
            (pose * Point3::from(bone.com)).coords.cross(&(GRAVITY * bone.mass))
        };
        self.bones.iter().zip(poses).map(of).sum()
    }

    fn joint_torque(&self, bone: usize, poses: &[Isometry3<f64>]) -> f64 {
        let pose = &poses[bone];
        let origin = Point3::from(pose.translation.vector);
        (pose.rotation * self.bones[bone].axis).dot(&self.load_about(bone, poses, &origin))
    }

    /// Random postures, each as often as there are views.
    pub(super) fn commanded(&self, plan: &Plan, rng: &mut ChaCha8Rng) -> Vec<Vec<f64>> {
        let mut out = Vec::new();
        for _ in 0..plan.postures {
            let mut q: Vec<f64> = (0..self.bones.len())
                .map(|b| {
                    let widest = if self.neck && b == 0 { 0.12 } else { 0.45 };
                    (rng.random_range(-widest..widest) * 1e4_f64).round() / 1e4
                })
                .collect();
            for (follower, leader, factor) in &self.geared {
                q[*follower] = factor * q[*leader];
            }
            out.extend(std::iter::repeat_n(q, plan.views));
        }
        out
    }

    /// Where the output of a joint with play lies from its commanded position, row by row.
    fn play(&self, commanded: &[Vec<f64>], joint: usize, width: f64, friction: f64) -> Vec<f64> {
        let straight = vec![Vec::new(); self.bones.len()];
        let mut last = vec![0.0; self.bones.len()];
        let mut output = 0.0;
        commanded
            .iter()
            .map(|row| {
                for step in 1..=PLAY_STEPS {
                    let share = step as f64 / PLAY_STEPS as f64;
                    let q: Vec<f64> = last.iter().zip(row).map(|(a, b)| a + (b - a) * share).collect();
                    let torque = self.joint_torque(joint, &self.chain(&q, &[], &straight));
                    let (low, high) = (q[joint] - width / 2.0, q[joint] + width / 2.0);
                    output = if torque > friction {
                        high
                    } else if torque < -friction {
                        low
                    } else {
                        f64::clamp(output, low, high)
                    };
                }
                last.clone_from(row);
                output - row[joint]
            })
            .collect()
    }

    /// The real positions of all joints in all rows, before anything gives way.
    pub(super) fn actual(&self, plan: &Plan, commanded: &[Vec<f64>]) -> Vec<Vec<f64>> {
        let mut out = commanded.to_vec();
        for w in &plan.wrong {
            let slack = match w {
                Wrong::Backlash(j, width, friction) => self.play(commanded, *j, *width, *friction),
                _ => Vec::new(),
            };
            let (mut last, mut sign) = (0.0, 0.0);
            for (f, theta) in out.iter_mut().enumerate() {
                let q = &commanded[f];
                match *w {
                    Wrong::Offset(j, a) => theta[j] += a,
                    Wrong::Ratio(j, e) => theta[j] += e * q[j],
                    Wrong::Eccentric(j, s, c) => theta[j] += s * q[j].sin() + c * q[j].cos() - c,
                    Wrong::Backlash(j, ..) => theta[j] += slack[f],
                    Wrong::Stiction(j, d) => {
                        if q[j] != last {
                            sign = if q[j] > last { 1.0 } else { -1.0 };
                        }
                        last = q[j];
                        theta[j] -= d * sign;
                    }
                    Wrong::Coupling(j, k, c) => theta[j] += c * q[k],
                    Wrong::Drift(j, rate) => theta[j] += rate * f as f64,
                    Wrong::ZeroWarms(j, end) => theta[j] += end * plan.warmth(f),
                    Wrong::Held(j, first, end) if (first..=end).contains(&f) => {
                        theta[j] += commanded[first][j] - q[j];
                    }
                    _ => {}
                }
            }
        }
        for (theta, q) in out.iter_mut().zip(commanded) {
            for (follower, leader, factor) in &self.geared {
                theta[*follower] += factor * (theta[*leader] - q[*leader]);
            }
        }
        out
    }

    /// Gravity's torque on a joint and, through their gears, on those that it drives.
    fn driving_torque(&self, joint: usize, poses: &[Isometry3<f64>]) -> f64 {
        let driven = self.geared.iter().filter(|(_, leader, _)| *leader == joint);
        let passed: f64 =
            driven.map(|(follower, _, factor)| factor * self.joint_torque(*follower, poses)).sum();
        self.joint_torque(joint, poses) + passed
    }

    /// Poses of the bones with all that gives way under load in balance with the load.
    pub(super) fn settled(&self, plan: &Plan, theta: &[f64]) -> Vec<Isometry3<f64>> {
        let mut bends = vec![Vec::new(); self.bones.len()];
        let mut poses = self.chain(theta, &plan.wrong, &bends);
        for _ in 0..6 {
            let rigid = theta;
            let mut theta = theta.to_vec();
            for w in &plan.wrong {
                match *w {
                    Wrong::Compliance(j, c) => theta[j] += c * self.driving_torque(j, &poses),
                    Wrong::Stiffening(j, c, share, reference) => {
                        let soft = c * self.joint_torque(j, &poses);
                        // The force grows with the way: halving finds where they balance.
                        let (mut low, mut high) = (0.0, soft.abs());
                        for _ in 0..50 {
                            let way = 0.5 * (low + high);
                            let force = way * (1.0 + share * f64::powi(way / reference, 2));
                            if force < soft.abs() { low = way } else { high = way }
                        }
                        theta[j] += low.copysign(soft);
                    }
                    Wrong::Bending(b, c) => {
                        let middle = poses[b] * Point3::from(self.tip(b) / 2.0);
                        let load = poses[b].rotation.inverse() * self.load_about(b, &poses, &middle);
                        let along = self.tip(b).normalize();
                        bends[b] = vec![(load - along * along.dot(&load)) * c];
                    }
                    Wrong::Beam(b, c) => {
                        let along = self.tip(b).normalize();
                        let bend = |piece| {
                            let load = self.load_beyond(b, &poses, middle_of(piece, BEAM_PIECES));
                            (load - along * along.dot(&load)) * (c / BEAM_PIECES as f64)
                        };
                        bends[b] = (0..BEAM_PIECES).map(bend).collect();
                    }
                    _ => {}
                }
            }
            for (follower, leader, factor) in &self.geared {
                theta[*follower] += factor * (theta[*leader] - rigid[*leader]);
            }
            poses = self.chain(&theta, &plan.wrong, &bends);
        }
        poses
    }

    /// Positions of the markers in the base.
    pub(super) fn marker_points(&self, plan: &Plan, poses: &[Isometry3<f64>]) -> Vec<Point3<f64>> {
        self.markers
            .iter()
            .enumerate()
            .map(|(m, (_, bone, at))| {
                let mut at = *at;
                for w in &plan.wrong {
                    match w {
                        Wrong::Mount(marker, d) if *marker == m => at += Vector3::from(*d),
                        _ => {}
                    }
                }
                poses[*bone] * Point3::from(at)
            })
            .collect()
    }
}
