//! What a layer does to its sums: activations on vectors, with both derivatives.

use bake_runtime::simd::{Vector, sigmoid};

/// A function of one number, and what its tangents and their adjoints need of it.
pub trait Activation: Copy + Send + 'static {
    /// Whether there is one at all: the last layer is linear and keeps no derivatives.
    const HIDDEN: bool;

    /// Whether the second derivative is other than 0.
    const CURVED: bool;

    /// Value, slope and second derivative at `z`.
    fn at<V: Vector>(z: V) -> [V; 3];
}

/// z·σ(z).
#[derive(Clone, Copy)]
pub struct Silu;

/// max(z, 0).
#[derive(Clone, Copy)]
pub struct Relu;

/// z.
#[derive(Clone, Copy)]
pub struct Linear;

impl Activation for Silu {
    const HIDDEN: bool = true;
    const CURVED: bool = true;

    #[inline(always)]
    fn at<V: Vector>(z: V) -> [V; 3] {
        let one = z.splat(1.0);
        let sigma = sigmoid(z);
        let rest = one - sigma;
        let value = z * sigma;
        // s' = σ + s·(1 − σ); s'' = (1 − σ)·(2σ + s − 2s·σ) = (1 − σ)·(σ + s' − s·σ).
        let slope = value.mul_add(rest, sigma);
        let bend = rest * (sigma + (-value).mul_add(sigma, slope));
        [value, slope, bend]
    }
}

impl Activation for Relu {
    const HIDDEN: bool = true;
    const CURVED: bool = false;

    #[inline(always)]
    fn at<V: Vector>(z: V) -> [V; 3] {
        let zero = z.splat(0.0);
        let negative = z.less(zero);
        [
            V::select(negative, zero, z),
            V::select(negative, zero, z.splat(1.0)),
            zero,
        ]
    }
}

impl Activation for Linear {
    const HIDDEN: bool = false;
    const CURVED: bool = false;

    #[inline(always)]
    fn at<V: Vector>(z: V) -> [V; 3] {
        [z, z.splat(1.0), z.splat(0.0)]
    }
}
