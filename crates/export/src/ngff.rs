//! The versions of OME-Zarr, by the name of its specification (NGFF).

use std::str::FromStr;

/// A version of OME-Zarr for exports, with one older than those of stores.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Ngff {
    /// 0.4, in Zarr 2: for older programs.
    V04,
    /// 0.5, in Zarr 3: also a store of this program.
    #[default]
    V05,
    /// 0.6, in Zarr 3: with the orientation.
    V06,
}

impl Ngff {
    /// All versions.
    pub const ALL: [Self; 3] = [Self::V04, Self::V05, Self::V06];

    /// The version's number.
    pub const fn name(self) -> &'static str {
        match self {
            Self::V04 => "0.4",
            Self::V05 => "0.5",
            Self::V06 => "0.6",
        }
    }
}

impl FromStr for Ngff {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        let known = || Self::ALL.map(Self::name).join(", ");
        Self::ALL
            .into_iter()
            .find(|version| version.name() == name)
            .ok_or_else(|| format!("unknown version '{name}' of OME-Zarr: expected one of {}", known()))
    }
}
