//! Steps along running means of the gradient, divided by the root of its running mean square: Adam, and the
//! rectified Adam inside Ranger.

/// Decays of the two running means, and what keeps a step finite where a gradient is zero.
#[derive(Clone, Copy, Debug)]
pub struct Moments {
    /// Decay of the mean.
    first: f64,
    /// Decay of the mean square.
    second: f64,
    /// Added to the root of the mean square.
    epsilon: f64,
}

/// The default parameters of Kingma and Ba 2015, Algorithm 1.
pub const ADAM: Moments = Moments {
    first: 0.9,
    second: 0.999,
    epsilon: 1e-8,
};

/// The default parameters of the released Ranger (Wright 2019, version 20.4.11).
pub const RANGER: Moments = Moments {
    first: 0.95,
    second: 0.999,
    epsilon: 1e-5,
};

/// Rectification begins above this length ρ_t of the approximated moving average, as in the released RAdam and
/// Ranger; the variance is finite from 4 on (Liu et al. 2020, Algorithm 2).
const LENGTH_MIN: f64 = 5.0;

/// What a step divides the mean of the gradient by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Divisor {
    /// √(`unbias`·v) + ε.
    Adaptive {
        /// Makes up for a mean square that began at zero.
        unbias: f32,
    },
    /// 1.
    None,
}

/// One step: value −= `scale`·m / divisor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stride {
    /// Learning rate, with the correction for a mean that began at zero.
    pub scale: f32,
    /// What else the mean is divided by.
    pub divisor: Divisor,
}

impl Moments {
    /// Adam's step number `step`, from 1 on (Kingma and Ba 2015, Algorithm 1).
    pub fn adam(self, step: u64, rate: f64) -> Stride {
        let step = step as f64;
        Stride {
            scale: (rate / (1.0 - self.first.powf(step))) as f32,
            divisor: Divisor::Adaptive {
                unbias: (1.0 / (1.0 - self.second.powf(step))) as f32,
            },
        }
    }

    /// Rectified Adam's step number `step`, from 1 on (Liu et al. 2020, Algorithm 2): along the mean alone while
    /// the mean square says too little. ε stands beside the root before its correction, as in the released code.
    pub fn rectified(self, step: u64, rate: f64) -> Stride {
        let step = step as f64;
        let power = self.second.powf(step);
        let limit = 2.0 / (1.0 - self.second) - 1.0;
        let length = limit - 2.0 * step * power / (1.0 - power);
        let scale = rate / (1.0 - self.first.powf(step));
        if length <= LENGTH_MIN {
            return Stride {
                scale: scale as f32,
                divisor: Divisor::None,
            };
        }
        let rectification =
            ((length - 4.0) * (length - 2.0) * limit) / ((limit - 4.0) * (limit - 2.0) * length);
        Stride {
            scale: (scale * (rectification * (1.0 - power)).sqrt()) as f32,
            divisor: Divisor::Adaptive { unbias: 1.0 },
        }
    }

    /// Moves the mean `first` towards `gradient`.
    pub fn average(self, first: &mut [f32], gradient: impl Iterator<Item = f32>) {
        let (keep, take) = (self.first as f32, (1.0 - self.first) as f32);
        first
            .iter_mut()
            .zip(gradient)
            .for_each(|(m, g)| *m = keep * *m + take * g);
    }

    /// Moves the mean square `second` towards that of `gradient`.
    pub fn average_square(self, second: &mut [f32], gradient: impl Iterator<Item = f32>) {
        let (keep, take) = (self.second as f32, (1.0 - self.second) as f32);
        second
            .iter_mut()
            .zip(gradient)
            .for_each(|(v, g)| *v = keep * *v + take * g * g);
    }

    /// Takes the step `stride`.
    pub fn step(self, value: &mut [f32], first: &[f32], second: &[f32], stride: Stride) {
        let scale = stride.scale;
        match stride.divisor {
            Divisor::None => value.iter_mut().zip(first).for_each(|(w, m)| *w -= scale * m),
            Divisor::Adaptive { unbias } => {
                let epsilon = self.epsilon as f32;
                for ((w, m), v) in value.iter_mut().zip(first).zip(second) {
                    *w -= scale * m / ((v * unbias).sqrt() + epsilon);
                }
            }
        }
    }
}
