//! Counter-based random numbers: a generator is hashed from its arguments, so the same query gives the
//! same numbers in any order and on any number of threads.
//!
//! Source: Steele, Lea and Flood 2014, *Fast Splittable Pseudorandom Number Generators* (SplitMix64).

use crate::real::Real;

/// Increment of the Weyl sequence behind SplitMix64: the odd integer nearest 2⁶⁴/φ.
const GOLDEN_GAMMA: u64 = 0x9e37_79b9_7f4a_7c15;

/// A SplitMix64 stream; cheap to make, so make one per query.
#[derive(Clone, Debug)]
pub struct Rng {
    state: u64,
}

/// Where uniform numbers come from: a stream, or a few chosen ones before it.
pub trait Uniforms {
    /// Uniform in `[0, 1)`.
    fn uniform(&mut self) -> Real;

    /// Two uniforms in `[0, 1)²`.
    fn pair(&mut self) -> [Real; 2] {
        [self.uniform(), self.uniform()]
    }
}

/// SplitMix64's finaliser: a bijection of 64 bits with full avalanche.
fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

impl Rng {
    /// The stream that belongs to `key`, e.g. `&[seed, slice, sample]`; different keys give unrelated streams.
    pub fn new(key: &[u64]) -> Self {
        let state = key.iter().fold(GOLDEN_GAMMA, |h, &k| {
            mix(h ^ mix(k.wrapping_add(GOLDEN_GAMMA))).wrapping_add(GOLDEN_GAMMA)
        });
        Rng { state }
    }

    /// 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.state = self.state.wrapping_add(GOLDEN_GAMMA);
        mix(self.state)
    }

    /// Uniform in `[0, 1)`, a multiple of the spacing of numbers just below 1 (2⁻⁵³).
    pub fn uniform(&mut self) -> Real {
        const DIGITS: u32 = Real::MANTISSA_DIGITS;
        (self.bits() >> (u64::BITS - DIGITS)) as Real * (1.0 / (1u64 << DIGITS) as Real)
    }

    /// Two uniforms in `[0, 1)²`.
    pub fn pair(&mut self) -> [Real; 2] {
        Uniforms::pair(self)
    }
}

impl Uniforms for Rng {
    fn uniform(&mut self) -> Real {
        Rng::uniform(self)
    }
}

/// A few chosen numbers, then a stream.
#[derive(Clone, Debug)]
pub struct Prefixed<const N: usize> {
    chosen: [Real; N],
    used: usize,
    rest: Rng,
}

impl<const N: usize> Prefixed<N> {
    /// `chosen` in `[0, 1)`, then `rest`.
    pub fn new(chosen: [Real; N], rest: Rng) -> Self {
        Prefixed {
            chosen,
            used: 0,
            rest,
        }
    }
}

impl<const N: usize> Uniforms for Prefixed<N> {
    fn uniform(&mut self) -> Real {
        match self.chosen.get(self.used) {
            Some(&number) => {
                self.used += 1;
                number
            }
            None => self.rest.uniform(),
        }
    }
}

/// The numbers of `count` walks, keyed by `key` and `seed`: a pair for the first interaction and `N` numbers for what
/// follows are Owen-scrambled Sobol points (Burley 2020, *Practical Hash-based Owen Scrambling*), the rest is random.
///
/// Walks in this order are stratified, and each is uniform over all seeds.
pub fn stratified<const N: usize>(
    key: u64,
    seed: u64,
    count: usize,
) -> impl Iterator<Item = ([Real; 2], Prefixed<N>)> {
    (0..count as u64).map(move |i| {
        // The library's sequence ends after 2¹⁶ points; the next one is scrambled anew.
        let scramble = (Rng::new(&[key, seed, i >> 16]).bits() >> 32) as u32;
        let at = |dimension| Real::from(sobol_burley::sample(i as u32 & 0xffff, dimension, scramble));
        let chosen = std::array::from_fn(|k| at(k as u32 + 2));
        ([at(0), at(1)], Prefixed::new(chosen, Rng::new(&[key, seed, i])))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Mean of 2²⁰ uniforms: its standard error is 2.8e-4, five of which no honest stream exceeds.
    const MEAN_TOL: Real = 1.4e-3;

    #[test]
    fn uniforms_are_uniform_and_keyed() {
        let n = 1 << 20;
        let mut rng = Rng::new(&[1, 2, 3]);
        let (mut sum, mut square) = (0.0, 0.0);
        for _ in 0..n {
            let u = rng.uniform();
            assert!((0.0..1.0).contains(&u));
            sum += u;
            square += u * u;
        }
        assert!((sum / n as Real - 0.5).abs() < MEAN_TOL);
        assert!((square / n as Real - 1.0 / 3.0).abs() < MEAN_TOL);
        assert_eq!(Rng::new(&[1, 2, 3]).bits(), Rng::new(&[1, 2, 3]).bits());
        assert_ne!(Rng::new(&[1, 2, 3]).bits(), Rng::new(&[1, 3, 2]).bits());
    }
}
