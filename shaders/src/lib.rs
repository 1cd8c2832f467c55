//! The WGSL of the renderer, by concern, composed by joining files: a variant holds just what it uses, so what is off
//! costs nothing. Bindings of group 0: 0 frame, 1 cells or bricks, 2 atlas, 3 sampler, 4 transfer table, 5 gathered picture,
//! 6 octree nodes, 7 ranges of macro-cells, 8 counts of opaque entries, 9 how bricks were entered.

mod layout;

pub use layout::{CellInstance, FrameUniform, HALVES_X, LEAF, NO_RANGES, RayBrick};

/// How a cell's samples become its pixel, and how cells meet.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Gather {
    /// Emission and absorption; cells blend *over* each other.
    Composite,
    /// Maximum or minimum; cells blend by max.
    Project,
    /// Sums of value and length; cells add.
    Average,
    /// The first surface; cells blend *over* each other.
    Isosurface,
}

impl Gather {
    /// All four.
    pub const ALL: [Self; 4] = [Self::Composite, Self::Project, Self::Average, Self::Isosurface];

    /// Whether what is in front hides what is behind: then rays can say with how much light they entered a brick.
    pub const fn occludes(self) -> bool {
        match self {
            Self::Composite | Self::Isosurface => true,
            Self::Project | Self::Average => false,
        }
    }
}

/// Steps of a brick's mark: a transmittance of 1.
pub const MARK_STEPS: u32 = 255;

const FRAME: &str = include_str!("../wgsl/frame.wgsl");
const CLASSIFY: &str = include_str!("../wgsl/classify.wgsl");
const FULLSCREEN: &str = include_str!("../wgsl/fullscreen.wgsl");

/// The sorted compositor's march: entry points `proxy` and `march`. With `has_invalid`, code 0 is no value and is left
/// out of interpolation.
pub fn sorted(gather: Gather, has_invalid: bool) -> String {
    let march = match gather {
        Gather::Composite | Gather::Project | Gather::Average => include_str!("../wgsl/march_samples.wgsl"),
        Gather::Isosurface => include_str!("../wgsl/march_surface.wgsl"),
    };
    [&marching(gather, has_invalid), include_str!("../wgsl/sorted.wgsl"), march].join("\n")
}

/// The raycast compositor's pass: entry points `fullscreen` and `raycast`. `has_invalid` as for [`sorted`]. With `marks`,
/// composites and surfaces say how bricks were entered (binding 9, a [`MARK_STEPS`]th a step).
pub fn raycast(gather: Gather, has_invalid: bool, marks: bool) -> String {
    let sees = match gather {
        Gather::Composite => include_str!("../wgsl/sees_composite.wgsl"),
        Gather::Project => include_str!("../wgsl/sees_project.wgsl"),
        Gather::Average => include_str!("../wgsl/sees_average.wgsl"),
        Gather::Isosurface => include_str!("../wgsl/sees_surface.wgsl"),
    };
    let (tree, macrocells) = (include_str!("../wgsl/tree.wgsl"), include_str!("../wgsl/macrocells.wgsl"));
    let mark = match gather.occludes() && marks {
        true => include_str!("../wgsl/mark.wgsl"),
        false => include_str!("../wgsl/mark_none.wgsl"),
    };
    let raycast = match gather {
        Gather::Composite | Gather::Project | Gather::Average => include_str!("../wgsl/raycast_samples.wgsl"),
        Gather::Isosurface => include_str!("../wgsl/raycast_surface.wgsl"),
    };
    let parts = [tree, macrocells, sees, mark, FULLSCREEN, include_str!("../wgsl/raycast.wgsl"), raycast];
    [marching(gather, has_invalid), parts.join("\n")].join("\n")
}

/// What all marches share: the ray, its pixel's threshold, its lattice, a sample's value, and what samples add up to.
fn marching(gather: Gather, has_invalid: bool) -> String {
    let sample = match has_invalid {
        false => include_str!("../wgsl/sample.wgsl"),
        true => include_str!("../wgsl/sample_valid.wgsl"),
    };
    let accumulate = match gather {
        Gather::Composite => include_str!("../wgsl/composite.wgsl"),
        Gather::Project => include_str!("../wgsl/project.wgsl"),
        Gather::Average => include_str!("../wgsl/average.wgsl"),
        Gather::Isosurface => include_str!("../wgsl/surface.wgsl"),
    };
    let (ray, lattice) = (include_str!("../wgsl/ray.wgsl"), include_str!("../wgsl/lattice.wgsl"));
    let dither = include_str!("../wgsl/dither.wgsl");
    [FRAME, ray, dither, lattice, sample, CLASSIFY, accumulate].join("\n")
}

/// The pass from the gathered picture to display colours: entry points `fullscreen` and `resolve`.
pub fn resolve(gather: Gather) -> String {
    let resolve = match gather {
        Gather::Composite | Gather::Isosurface => include_str!("../wgsl/resolve_composite.wgsl"),
        Gather::Project => include_str!("../wgsl/resolve_project.wgsl"),
        Gather::Average => include_str!("../wgsl/resolve_average.wgsl"),
    };
    [FRAME, CLASSIFY, FULLSCREEN, resolve].join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;
    use brickyard_volume::surface;
    use naga::{Module, TypeInner};
    use std::mem::{offset_of, size_of};

    /// Every shader there is, with a name for messages.
    fn variants() -> Vec<(String, String)> {
        let mut all = Vec::new();
        for gather in Gather::ALL {
            for has_invalid in [false, true] {
                all.push((format!("sorted {gather:?} invalid {has_invalid}"), sorted(gather, has_invalid)));
                for marks in [false, true] {
                    let name = format!("raycast {gather:?} invalid {has_invalid} marks {marks}");
                    all.push((name, raycast(gather, has_invalid, marks)));
                }
            }
            all.push((format!("resolve {gather:?}"), resolve(gather)));
        }
        all
    }

    fn parse(name: &str, source: &str) -> Module {
        naga::front::wgsl::parse_str(source).unwrap_or_else(|e| panic!("{name}: {}", e.emit_to_string(source)))
    }

    #[test]
    fn every_variant_is_valid() {
        use naga::valid::{Capabilities, ValidationFlags, Validator};
        for (name, source) in variants() {
            let module = parse(&name, &source);
            let checked = Validator::new(ValidationFlags::all(), Capabilities::empty()).validate(&module);
            assert!(checked.is_ok(), "{name}: {:?}", checked.err());
            assert_eq!(module.entry_points.len(), 2, "{name}");
        }
    }

    /// Members as (name, offset), and the span, of a struct.
    fn layout(module: &Module, name: &str) -> (Vec<(String, usize)>, usize) {
        for (_, ty) in module.types.iter() {
            if let (Some(n), TypeInner::Struct { members, span }) = (&ty.name, &ty.inner)
                && n == name
            {
                let member = |m: &naga::StructMember| (m.name.clone().unwrap_or_default(), m.offset as usize);
                return (members.iter().map(member).collect(), *span as usize);
            }
        }
        panic!("no struct {name}");
    }

    macro_rules! offsets {
        ($t:ty: $($field:ident)*) => { vec![$((stringify!($field).to_string(), offset_of!($t, $field))),*] };
    }

    #[test]
    fn structs_have_the_layout_of_their_twins() {
        for (name, source) in variants() {
            let module = parse(&name, &source);
            let expected = offsets!(FrameUniform: eye step forward slack right half_width up half_height clip_x near clip_y
                pixel_share clip_w per_unit_distance extent last_code spacing orthographic texel invert background tree_depth
                size_px last_place spare_2 root_size macro_cells shown_low slot_edge shown_high spare_4 surface_color
                threshold zone_starts);
            assert_eq!(layout(&module, "Frame"), (expected, size_of::<FrameUniform>()), "{name}");
            if name.starts_with("sorted") {
                let expected = offsets!(CellInstance: region_min pixels_from region_max pixels_to texel_scale spare
                    texel_offset spare_2);
                assert_eq!(layout(&module, "Cell"), (expected, size_of::<CellInstance>()), "{name}");
            }
            if name.starts_with("raycast") {
                let expected = offsets!(RayBrick: texel_scale first_range texel_offset range low pixels_to);
                assert_eq!(layout(&module, "RayBrick"), (expected, size_of::<RayBrick>()), "{name}");
            }
        }
    }

    #[test]
    fn constants_are_those_of_the_shader() {
        let module = parse("raycast", &raycast(Gather::Isosurface, false, true));
        let single = |value: f64| naga::Literal::F32(value as f32);
        let expected = [
            ("PARTS", naga::Literal::U32(surface::PARTS as u32)),
            ("ROUNDS", naga::Literal::U32(surface::ROUNDS as u32)),
            ("AMBIENT", single(surface::AMBIENT)),
            ("DIFFUSE", single(surface::DIFFUSE)),
            ("SPECULAR", single(surface::SPECULAR)),
            ("SPECULAR_POWER", single(surface::SPECULAR_POWER as f64)),
            ("FLAT_CODES", single(surface::FLAT_CODES)),
            ("LEAF", naga::Literal::U32(LEAF)),
            ("GROUP", naga::Literal::U32(HALVES_X - 1)),
            ("MARK_STEPS", naga::Literal::F32(MARK_STEPS as f32)),
            ("NO_RANGES", naga::Literal::U32(NO_RANGES)),
        ];
        for (name, value) in expected {
            let (_, constant) = module.constants.iter().find(|(_, c)| c.name.as_deref() == Some(name)).expect(name);
            let found = &module.global_expressions[constant.init];
            assert!(matches!(found, naga::Expression::Literal(v) if *v == value), "{name}: {found:?}");
        }
    }
}
