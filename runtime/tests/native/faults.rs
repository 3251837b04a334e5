//! The suite notices: backends that are wrong in one way each, and the check that must say so.

use crate::inverted::backend;
use bake_runtime::conformance::{Check, Tolerance, boxed, checks};
use bake_runtime::native::{NativeBackend, Tier};
use bake_runtime::{Backend, BakedMaterial, Error, Points, Result};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread::ThreadId;

/// What is wrong with a backend.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Fault {
    /// Nothing: the wrapper itself is sound.
    None,
    /// Jacobians have the other sign.
    WrongSign,
    /// Directions are off by 2e-4.
    Inaccurate,
    /// Directions are longer than 1.
    NotUnit,
    /// Directions point below the horizon.
    BelowTheHorizon,
    /// Weights are negative.
    NegativeWeight,
    /// Large networks give infinite values.
    Overflow,
    /// The last query of a batch gets the answer of the one before.
    Tail,
    /// Answers stay unwritten where a batch does not fill its last vector of sixteen.
    Remainder,
    /// A parameter that the batch shares is taken for 0.
    SharedParameter,
    /// Every third call rounds otherwise.
    Memory,
    /// Other threads than the one that made it get other answers.
    Thread,
    /// Both ways to sample draw other directions.
    OtherDirection,
    /// Invalid queries give NaN.
    NanLeak,
    /// What follows an invalid query is refused as well.
    Neighbour,
    /// u that is not below 1 gives NaN.
    OddU,
    /// Directions that are not unit give infinities.
    OddLength,
    /// Lengths are not checked.
    AnyLength,
    /// Lengths are checked, but another argument is named.
    OtherName,
    /// Lengths are checked after everything is written.
    WritesFirst,
}

/// The fastest tier with a fault.
struct Faulty {
    inner: NativeBackend,
    fault: Fault,
    calls: AtomicU64,
    maker: ThreadId,
    /// Whether the weights are far larger than those of any bake.
    large: bool,
}

/// Outputs of a call, after the fact: `wi` first where there is one.
type Columns<'a, 'b> = &'a mut [&'b mut [f32]];
/// What asks the inner backend.
type Call<'a> = &'a dyn Fn(Points, &mut [&mut [f32]]) -> Result<()>;

impl Faulty {
    fn new(material: &BakedMaterial, fault: Fault) -> Faulty {
        let largest = material.eval.net[0]
            .weight
            .iter()
            .fold(0.0f32, |m, w| m.max(w.abs()));
        Faulty {
            inner: backend(material, Tier::best()),
            fault,
            calls: AtomicU64::new(0),
            maker: std::thread::current().id(),
            large: largest > 100.0,
        }
    }

    /// Calls `inner` with columns of parameters and outputs that fit, and spoils what it gives. `directions` are those that
    /// must be above the horizon, `u` the random numbers; `names` belong to the outputs.
    fn spoil(
        &self,
        points: Points,
        directions: &[[&[f32]; 3]],
        u: &[&[f32]],
        outputs: Columns,
        call: Call,
    ) -> Result<()> {
        let count = points.len();
        let lengths = outputs.iter().map(|column| column.len());
        let ragged = lengths.chain(directions.iter().flatten().chain(u).map(|column| column.len()));
        let ragged = ragged
            .chain(points.wo.map(<[f32]>::len))
            .any(|length| length != count);
        match self.fault {
            Fault::AnyLength if ragged => return Ok(()),
            Fault::WritesFirst if ragged => outputs.iter_mut().for_each(|column| column.fill(0.0)),
            _ => {}
        }
        let zero = [0.0f32];
        let shared: Vec<&[f32]> = points
            .params
            .iter()
            .map(|column| {
                if column.len() == 1 && count > 1 {
                    &zero[..]
                } else {
                    column
                }
            })
            .collect();
        let params = if self.fault == Fault::SharedParameter {
            &shared
        } else {
            points.params
        };
        match (call(Points { params, ..points }, outputs), self.fault) {
            (Ok(()), _) => {}
            (Err(Error::BatchLength { expected, found, .. }), Fault::OtherName) => {
                let name = "slices";
                return Err(Error::BatchLength {
                    name,
                    expected,
                    found,
                });
            }
            (other, _) => return other,
        }
        let invalid = |i: usize| {
            let wrong = |w: &[&[f32]; 3]| w.iter().any(|c| !c[i].is_finite()) || w[2][i] <= 0.0;
            directions.iter().chain([&points.wo]).any(wrong)
        };
        let squared = |w: &[&[f32]; 3], i: usize| w.iter().map(|c| c[i] * c[i]).sum::<f32>();
        let calls = self.calls.fetch_add(1, Ordering::Relaxed);
        for column in outputs.iter_mut() {
            for i in 0..count {
                let spoilt = match self.fault {
                    Fault::Tail if i > 0 && i + 1 == count => Some(column[i - 1]),
                    Fault::Remainder if i >= count - count % 16 => Some(f32::NAN),
                    Fault::Memory if calls % 3 == 1 => Some(column[i].next_up()),
                    Fault::Thread if std::thread::current().id() != self.maker => Some(column[i].next_up()),
                    Fault::NanLeak if invalid(i) => Some(f32::NAN),
                    Fault::Neighbour if i > 0 && invalid(i - 1) => Some(0.0),
                    Fault::OddU if u.iter().any(|u| u[i].is_nan() || u[i] >= 1.0) => Some(f32::NAN),
                    Fault::OddLength if !invalid(i) && squared(&points.wo, i).is_infinite() => {
                        Some(f32::INFINITY)
                    }
                    Fault::Overflow if self.large => Some(f32::INFINITY),
                    _ => None,
                };
                column[i] = spoilt.unwrap_or(column[i]);
            }
        }
        Ok(())
    }

    /// Spoils directions.
    fn bend(&self, wi: &mut [&mut [f32]; 3], way: Way) {
        match self.fault {
            Fault::Inaccurate => wi[0].iter_mut().for_each(|x| *x += 2e-4),
            Fault::NotUnit => wi
                .iter_mut()
                .for_each(|c| c.iter_mut().for_each(|v| *v *= 1.0 + 3e-6)),
            Fault::BelowTheHorizon => wi[2].iter_mut().for_each(|z| *z = -*z),
            Fault::OtherDirection if way == Way::Jacobian => {
                wi[0].iter_mut().for_each(|x| *x = x.next_up());
            }
            _ => {}
        }
    }
}

#[derive(Clone, Copy, PartialEq)]
enum Way {
    Learned,
    Jacobian,
}

impl Backend for Faulty {
    fn sample_learned(
        &self,
        points: Points,
        u: [&[f32]; 2],
        mut wi: [&mut [f32]; 3],
        weight: [&mut [f32]; 3],
    ) -> Result<()> {
        let [x, y, z] = &mut wi;
        let [r, g, b] = weight;
        self.spoil(points, &[], &u, &mut [x, y, z, &mut *r, g, b], &|points, out| {
            let [x, y, z, r, g, b] = out else {
                unreachable!("six columns")
            };
            self.inner.sample_learned(points, u, [x, y, z], [r, g, b])
        })?;
        self.bend(&mut wi, Way::Learned);
        if self.fault == Fault::NegativeWeight {
            r.iter_mut().for_each(|r| *r -= 0.5);
        }
        Ok(())
    }

    fn sample_jacobian(
        &self,
        points: Points,
        u: [&[f32]; 2],
        mut wi: [&mut [f32]; 3],
        jacobian: &mut [f32],
    ) -> Result<()> {
        let [x, y, z] = &mut wi;
        self.spoil(points, &[], &u, &mut [x, y, z, &mut *jacobian], &|points, out| {
            let [x, y, z, jacobian] = out else {
                unreachable!("four columns")
            };
            self.inner.sample_jacobian(points, u, [x, y, z], jacobian)
        })?;
        self.bend(&mut wi, Way::Jacobian);
        if self.fault == Fault::WrongSign {
            jacobian.iter_mut().for_each(|j| *j = -*j);
        }
        Ok(())
    }

    fn eval(&self, points: Points, wi: [&[f32]; 3], f_cos: [&mut [f32]; 3]) -> Result<()> {
        let [r, g, b] = f_cos;
        self.spoil(points, &[wi], &[], &mut [r, g, b], &|points, out| {
            let [r, g, b] = out else {
                unreachable!("three columns")
            };
            self.inner.eval(points, wi, [r, g, b])
        })
    }

    fn pdf(&self, points: Points, wi: [&[f32]; 3], pdf: &mut [f32]) -> Result<()> {
        self.spoil(points, &[wi], &[], &mut [pdf], &|points, out| {
            let [pdf] = out else { unreachable!("one column") };
            self.inner.pdf(points, wi, pdf)
        })
    }
}

/// Whether `check` panics on a backend with `fault`.
fn notices(check: Check, fault: Fault) -> bool {
    let run = || {
        let make = |material: &BakedMaterial| boxed(material, |material| Faulty::new(material, fault));
        check(&make, Tolerance::EXACT);
    };
    catch_unwind(AssertUnwindSafe(run)).is_err()
}

#[test]
fn every_check_notices_what_it_is_about() {
    let checks: [(Check, &[Fault]); 11] = [
        (
            checks::agrees_with_the_oracle,
            &[Fault::WrongSign, Fault::Inaccurate, Fault::Remainder, Fault::Tail],
        ),
        (
            checks::directions_are_unit_and_everything_is_finite,
            &[
                Fault::NotUnit,
                Fault::BelowTheHorizon,
                Fault::NegativeWeight,
                Fault::Remainder,
            ],
        ),
        (checks::saturated_networks_stay_finite, &[Fault::Overflow]),
        (
            checks::batches_of_any_size_give_the_same_answers,
            &[Fault::Tail, Fault::Remainder],
        ),
        (
            checks::one_value_of_a_parameter_is_that_of_the_whole_batch,
            &[Fault::SharedParameter],
        ),
        (checks::repeated_calls_give_the_same_bytes, &[Fault::Memory]),
        (
            checks::threads_that_share_a_backend_get_the_same_bytes,
            &[Fault::Thread, Fault::Memory],
        ),
        (
            checks::both_ways_to_sample_draw_the_same_direction,
            &[Fault::OtherDirection],
        ),
        (
            checks::invalid_queries_give_zeros_and_leave_their_neighbours_alone,
            &[Fault::NanLeak, Fault::Neighbour],
        ),
        (
            checks::odd_numbers_give_finite_answers,
            &[Fault::OddU, Fault::OddLength],
        ),
        (
            checks::slices_of_wrong_length_are_named_and_nothing_is_written,
            &[Fault::AnyLength, Fault::OtherName, Fault::WritesFirst],
        ),
    ];
    for (number, (check, faults)) in checks.into_iter().enumerate() {
        assert!(
            !notices(check, Fault::None),
            "check {number} fails without a fault"
        );
        for fault in faults {
            assert!(notices(check, *fault), "check {number} passes {fault:?}");
        }
    }
}
