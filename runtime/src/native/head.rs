//! From the outputs of a sampling network to a position: the heads that [`crate::spec::Geometry`] describes.

use super::math::exp;
use super::vector::Vector;
use crate::spec::{DISK_HEIGHT_MIN, WARP_SHIFT_MAX};

/// One coordinate of a position, h = u/(u + (1 − u)·e⁻ᵍ); on the disk, where u does not enter, σ(g), which is h at u = ½.
pub struct Head<V> {
    /// Position in the square.
    pub h: V,
    /// 1 − h, with its own relative precision.
    pub complement: V,
    u: V,
    /// 1 − u.
    rest: V,
    g: V,
}

impl<V: Vector> Head<V> {
    /// The head on the output `g`; `rest` = 1 − `u`, given apart because the caller knows it more precisely than a
    /// subtraction would.
    #[inline(always)]
    pub fn new(u: V, rest: V, g: V) -> Self {
        let max = WARP_SHIFT_MAX as f32;
        let bent = rest * exp(-g.clamp(-max, max));
        let sum = u + bent;
        Head {
            h: u.over(sum),
            complement: bent.over(sum),
            u,
            rest,
            g,
        }
    }

    /// The head of the disk.
    #[inline(always)]
    pub fn on_disk(g: V) -> Self {
        Head::new(g.splat(0.5), g.splat(0.5), g)
    }

    /// ∂h/∂g, 0 where g is clamped.
    #[inline(always)]
    pub fn by_shift(&self) -> V {
        V::select(is_inside(self.g), self.h * self.complement, self.u.splat(0.0))
    }

    /// ∂h/∂u at fixed g.
    #[inline(always)]
    pub fn by_u(&self) -> V {
        (self.h * self.complement).over(self.u * self.rest)
    }
}

/// Where the output `g` is not clamped.
#[inline(always)]
pub fn is_inside<V: Vector>(g: V) -> V::Mask {
    g.abs().less(g.splat(WARP_SHIFT_MAX as f32))
}

/// Unit direction over the position `heads` of the square around the disk, and dω/dh there (sr), 0 outside of the disk.
#[inline(always)]
pub fn disk_direction<V: Vector>(heads: &[Head<V>; 2]) -> ([V; 3], V) {
    let [x, y] = [heads[0].h - heads[0].complement, heads[1].h - heads[1].complement];
    let least = x.splat((DISK_HEIGHT_MIN * DISK_HEIGHT_MIN) as f32);
    let (one, zero) = (x.splat(1.0), x.splat(0.0));
    let r2 = x.mul_add(x, y * y);
    let z2 = one - r2;
    let z = z2.max(least).sqrt();
    let scale = one / z.mul_add(z, r2).sqrt();
    let area = V::select(least.less(z2), z.splat(4.0) / z, zero);
    ([x * scale, y * scale, z * scale], area)
}
