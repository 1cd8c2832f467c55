//! Tricubic B-spline samples of a padded brick: 64 voxels each, in rows of four. As in `sample`, codes stay codes, and
//! invalid ones are left out of the sum and of the weight.

use crate::packet::{LANES, Packet};
use crate::sample::{Brick, Code};
use glam::{BVec4A, Vec4};

/// Weighted sums of the codes around a place, exact for equal codes, as an expression may compare them.
struct Sums {
    /// The code of the voxel before the place along each axis, 0 if it has no value.
    middle: f32,
    /// The weighted excess of the codes over `middle`.
    sum: f32,
    valid: f32,
}

impl Brick<'_> {
    /// Returns the codes at eight slot coordinates through the spline. The weights of those without a value become 0.
    #[inline(never)]
    pub(crate) fn cubic_points<C: Code>(&self, points: &[Packet; 3], weight: &mut Packet) -> Packet {
        let mut code = [0.0; LANES];
        for i in 0..LANES {
            let Sums { middle, sum, valid } = self.cubic::<C>([points[0][i], points[1][i], points[2][i]]);
            code[i] = middle + if C::INVALID { sum / valid.max(f32::MIN_POSITIVE) } else { sum };
            code[i] = if C::IS_FLOAT { self.map.code(code[i]) } else { code[i] };
            if C::INVALID && valid < 0.5 {
                weight[i] = 0.0;
            }
        }
        code
    }

    #[inline(always)]
    fn cubic<C: Code>(&self, point: [f32; 3]) -> Sums {
        let n = self.padded();
        let split = |v: f32| {
            // Keeps one voxel to the left and two to the right inside the brick.
            let v = v.clamp(1.0, ((n - 2) as f32).next_down());
            (v as usize, v.fract())
        };
        let [(x, tx), (y, ty), (z, tz)] = point.map(split);
        let (wx, wy, wz) = (weights(tx), weights(ty).to_array(), weights(tz).to_array());
        let (middle, _) = self.row::<C>((z * n + y) * n + x - 1);
        let middle = Vec4::splat(middle.y);
        let (mut sum, mut valid) = (Vec4::ZERO, Vec4::ZERO);
        for k in 0..4 {
            for j in 0..4 {
                let row = ((z + k - 1) * n + y + j - 1) * n + x - 1;
                let (codes, has_value) = self.row::<C>(row);
                let weight = Vec4::splat(wy[j] * wz[k]);
                let more = (codes - middle) * weight;
                if C::INVALID {
                    sum += Vec4::select(has_value, more, Vec4::ZERO);
                    valid += Vec4::select(has_value, weight, Vec4::ZERO);
                } else {
                    sum += more;
                }
            }
        }
        Sums { middle: middle.x, sum: sum.dot(wx), valid: valid.dot(wx) }
    }

    /// Four neighbouring codes, or differences to become codes, and which of the voxels have a value.
    #[inline(always)]
    fn row<C: Code>(&self, first: usize) -> (Vec4, BVec4A) {
        let codes = &self.codes[first * C::BYTES..][..4 * C::BYTES];
        // SAFETY: there are four codes.
        let [low, high] = unsafe { [C::pair(codes.as_ptr()), C::pair(codes.as_ptr().add(2 * C::BYTES))] };
        let [a, b, c, d] =
            [C::near(low), C::far(low), C::near(high), C::far(high)].map(|code| C::part(code, &self.map));
        (Vec4::new(a.0, b.0, c.0, d.0), BVec4A::new(a.1, b.1, c.1, d.1))
    }
}

/// [`brickyard_volume::sampling::b_spline`].
#[inline(always)]
fn weights(t: f32) -> Vec4 {
    let s = 1.0 - t;
    let (t2, s2) = (t * t, s * s);
    Vec4::new(s2 * s, 4.0 - 6.0 * t2 + 3.0 * t2 * t, 4.0 - 6.0 * s2 + 3.0 * s2 * s, t2 * t) * (1.0 / 6.0)
}
