//! Lit direct volume rendering by the plain method, the most frequent picture in a window.
//!
//! A chunk's samples are classified like unlit ones. Then light goes through its packets, and only visible packets
//! reached by light are lit.

use crate::packet::{LANES, PACKETS, points};
use crate::ray::{FAINTEST, Ray};
use crate::sample::{Code, SampleChunk};
use crate::shade::{Shade, Shaded};
use crate::stretch::March;
use crate::unit::Unit;
use glam::Vec4;

/// Passes light through the visible packets of a chunk. A call of its own on each vector unit: it is large.
#[inline(always)]
pub(crate) fn see<C: Code, U: Unit>(march: &March<'_>, ray: &Ray, chunk: &mut SampleChunk, shows: u32) -> Vec4 {
    U::call(
        (march, ray),
        #[inline(always)]
        move |(march, ray)| see_on::<C, U>(march, ray, chunk, shows),
    )
}

#[inline(always)]
fn see_on<C: Code, U: Unit>(march: &March<'_>, ray: &Ray, chunk: &mut SampleChunk, shows: u32) -> Vec4 {
    let stretch = march.stretch;
    let (eye, view) = ray.in_world(march.frame);
    let cut = march.cut(ray);
    let (slopes, flat_codes) = march.slopes();
    let shade = Shade::new(&march.frame.settings.lighting, slopes, flat_codes, eye, view, cut);
    let mut shaded = Shaded::EMPTY;
    let (mut color, mut light) = (ray.sum, ray.sum.w);
    for p in 0..chunk.packets.min(PACKETS) {
        if shows & 1 << p == 0 {
            continue;
        }
        let along = &chunk.along[p];
        let mut distance = [0.0; LANES];
        for i in 0..LANES {
            distance[i] = stretch.middle as f32 + along[i] * stretch.length as f32;
        }
        let points = points(stretch.origin, stretch.step, along);
        let (differences, rounded) = march.differences::<C, U>(&points, &chunk.code[p]);
        shade.packet(&differences, &distance, &rounded, &mut shaded);
        for i in 0..LANES {
            let step = chunk.entry[p][i];
            color += shade.lit(&shaded, i, step, 1.0 - step.w) * light;
            light *= step.w;
        }
        if light < FAINTEST {
            break;
        }
    }
    color.with_w(light)
}
