//! Paints egui's shapes on a picture, on the CPU: coloured triangles, and letters from an atlas. Colours, blending and pixel coverage are as on a
//! GPU. Costs the covered pixels.

use brickyard::volume::Picture;
use eframe::egui::epaint::{ClippedPrimitive, Primitive, Vertex};
use eframe::egui::{Color32, ColorImage, ImageData, Rect, TextureId, TexturesDelta, Vec2, vec2};
use std::collections::HashMap;

/// Draws tessellated shapes over a picture. `textures` must contain all of theirs.
pub(crate) fn put(picture: &mut Picture, shapes: &[ClippedPrimitive], textures: &TexturesDelta, pixels_per_point: f32) {
    let textures = images(textures);
    for ClippedPrimitive { clip_rect, primitive } in shapes {
        let Primitive::Mesh(mesh) = primitive else { continue };
        let Some(texture) = textures.get(&mesh.texture_id) else { continue };
        let mut target = Target { picture, texture, clip: *clip_rect * pixels_per_point, pixels_per_point };
        for corners in mesh.indices.chunks_exact(3) {
            target.triangle([0, 1, 2].map(|i| mesh.vertices[corners[i] as usize]));
        }
    }
}

/// The created textures, with later changes applied.
fn images(textures: &TexturesDelta) -> HashMap<TextureId, ColorImage> {
    let mut images = HashMap::new();
    for (id, deltas) in &textures.set {
        for delta in deltas {
            let ImageData::Color(image) = &delta.image;
            match delta.pos {
                None => drop(images.insert(*id, ColorImage::clone(image))),
                Some(corner) => images.get_mut(id).into_iter().for_each(|whole| patch(whole, image, corner)),
            }
        }
    }
    images
}

fn patch(whole: &mut ColorImage, image: &ColorImage, [left, top]: [usize; 2]) {
    for y in 0..image.size[1] {
        for x in 0..image.size[0] {
            whole[(left + x, top + y)] = image[(x, y)];
        }
    }
}

/// A picture, and the texture of the triangles drawn on it.
struct Target<'a> {
    picture: &'a mut Picture,
    texture: &'a ColorImage,
    /// The part to draw on, in pixels.
    clip: Rect,
    pixels_per_point: f32,
}

impl Target<'_> {
    fn triangle(&mut self, mut corners: [Vertex; 3]) {
        let place = |corner: &Vertex| corner.pos.to_vec2() * self.pixels_per_point;
        let area = cross(place(&corners[1]) - place(&corners[0]), place(&corners[2]) - place(&corners[0]));
        if area == 0.0 || !area.is_finite() {
            return;
        }
        if area < 0.0 {
            corners.swap(1, 2);
        }
        let places = [0, 1, 2].map(|i| place(&corners[i]));
        let (mut low, mut high) = (places[0].y, places[0].y);
        places.iter().for_each(|at| (low, high) = (low.min(at.y), high.max(at.y)));
        let rows = within(low.max(self.clip.top()), high.min(self.clip.bottom()), self.picture.height);
        for y in rows {
            let (left, right) = crossed(&places, y as f32 + 0.5);
            for x in within(left.max(self.clip.left()), right.min(self.clip.right()), self.picture.width) {
                if let Some(shares) = shares(&places, vec2(x as f32 + 0.5, y as f32 + 0.5), area.abs()) {
                    self.blend((y * self.picture.width + x) as usize, &corners, shares);
                }
            }
        }
    }

    /// Blends a triangle's colour at a place over a pixel.
    fn blend(&mut self, pixel: usize, corners: &[Vertex; 3], shares: [f32; 3]) {
        let of = |value: fn(&Vertex) -> f32| (0..3).map(|i| shares[i] * value(&corners[i])).sum::<f32>();
        let texel = sample(self.texture, [of(|corner| corner.uv.x), of(|corner| corner.uv.y)]);
        let color: [fn(&Vertex) -> f32; 4] = [
            |corner| corner.color.r().into(),
            |corner| corner.color.g().into(),
            |corner| corner.color.b().into(),
            |corner| corner.color.a().into(),
        ];
        // Premultiplied, in display-referred codes, as the window blends.
        let ink: [f32; 4] = std::array::from_fn(|i| of(color[i]) * texel[i]);
        let below = &mut self.picture.rgb[pixel];
        *below = std::array::from_fn(|i| (ink[i] + f32::from(below[i]) * (1.0 - ink[3] / 255.0)).round() as u8);
    }
}

fn cross(a: Vec2, b: Vec2) -> f32 {
    a.x * b.y - a.y * b.x
}

/// The pixels, out of `count`, whose centres may lie between two places.
fn within(low: f32, high: f32, count: u32) -> std::ops::Range<u32> {
    // Casts of floats saturate.
    (low - 0.5).ceil() as u32..((high + 0.5).floor() as u32).min(count)
}

/// Start and end of a triangle in a row.
fn crossed(places: &[Vec2; 3], y: f32) -> (f32, f32) {
    let (mut left, mut right) = (f32::INFINITY, f32::NEG_INFINITY);
    for i in 0..3 {
        let (a, b) = (places[i], places[(i + 1) % 3]);
        if (a.y <= y) != (b.y <= y) {
            let x = a.x + (b.x - a.x) * (y - a.y) / (b.y - a.y);
            (left, right) = (left.min(x), right.max(x));
        }
    }
    // Rounding may lose a pixel at either end: those are tested one by one.
    (left - 0.5, right + 0.5)
}

/// The weights of a triangle's corners at a place; `None` outside. A place on a common edge of two triangles belongs to just one.
fn shares(places: &[Vec2; 3], at: Vec2, area: f32) -> Option<[f32; 3]> {
    let mut shares = [0.0; 3];
    for i in 0..3 {
        let (from, to) = (places[(i + 1) % 3], places[(i + 2) % 3]);
        let edge = to - from;
        let side = cross(edge, at - from);
        let is_first = edge.y < 0.0 || edge.y == 0.0 && edge.x > 0.0;
        if side < 0.0 || side == 0.0 && !is_first {
            return None;
        }
        shares[i] = side / area;
    }
    Some(shares)
}

/// The texture's colour at a place from 0 to 1, as parts of 1, linear between texels.
fn sample(texture: &ColorImage, uv: [f32; 2]) -> [f32; 4] {
    let [width, height] = texture.size;
    if width == 0 || height == 0 {
        return [0.0; 4];
    }
    let (x, y) = (uv[0] * width as f32 - 0.5, uv[1] * height as f32 - 0.5);
    let texel = |x: f32, y: f32| -> Color32 {
        texture[((x.max(0.0) as usize).min(width - 1), (y.max(0.0) as usize).min(height - 1))]
    };
    let (left, top) = (x.floor(), y.floor());
    let (right_share, bottom_share) = (x - left, y - top);
    let mut sum = [0.0; 4];
    for (dx, share_x) in [(0.0, 1.0 - right_share), (1.0, right_share)] {
        for (dy, share_y) in [(0.0, 1.0 - bottom_share), (1.0, bottom_share)] {
            let color = texel(left + dx, top + dy).to_array();
            (0..4).for_each(|i| sum[i] += share_x * share_y * f32::from(color[i]) / 255.0);
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use eframe::egui::epaint::{ImageDelta, Mesh};
    use eframe::egui::{TextureOptions, pos2};

    /// Draws a mesh, placed in points, on a picture of 8 x 8 gray pixels, and returns its pixels.
    fn drawn(mesh: Mesh, clip_rect: Rect, pixels_per_point: f32) -> Vec<[u8; 3]> {
        let mut picture = Picture { width: 8, height: 8, rgb: vec![[100; 3]; 64] };
        let mut textures = TexturesDelta::default();
        let white = ColorImage::filled([1, 1], Color32::WHITE);
        textures.set.entry(TextureId::default()).or_default().push(ImageDelta::full(white, TextureOptions::LINEAR));
        put(
            &mut picture,
            &[ClippedPrimitive { clip_rect, primitive: Primitive::Mesh(mesh) }],
            &textures,
            pixels_per_point,
        );
        // egui insists on it.
        textures.clear();
        picture.rgb
    }

    #[test]
    fn each_pixel_of_a_rectangle_is_blended_once() {
        let mut mesh = Mesh::default();
        // Two triangles with a common edge through pixel centres.
        mesh.add_colored_rect(Rect::from_min_max(pos2(1.0, 1.0), pos2(3.0, 3.0)), Color32::from_white_alpha(128));
        let rgb = drawn(mesh, Rect::EVERYTHING, 2.0);
        for (i, pixel) in rgb.iter().enumerate() {
            let is_inside = (2..6).contains(&(i % 8)) && (2..6).contains(&(i / 8));
            assert_eq!(*pixel, if is_inside { [178; 3] } else { [100; 3] }, "pixel {i}");
        }
    }

    #[test]
    fn nothing_is_drawn_beside_the_clip_or_the_picture() {
        let mut mesh = Mesh::default();
        mesh.add_colored_rect(Rect::from_min_max(pos2(-90.0, -9.0), pos2(90.0, 99.0)), Color32::RED);
        let rgb = drawn(mesh, Rect::from_min_max(pos2(0.0, 2.0), pos2(4.0, 99.0)), 1.0);
        let red = rgb.iter().enumerate().filter(|(_, pixel)| **pixel == [255, 0, 0]).map(|(i, _)| (i % 8, i / 8));
        assert_eq!(red.clone().count(), 24);
        assert!(red.clone().all(|(x, y)| x < 4 && y >= 2));
    }
}
