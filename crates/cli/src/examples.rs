//! Examples of each command, for its help.

pub(crate) const PACK: &str = "\
Examples:
  brickyard pack scan.nii.gz scan.zarr
  brickyard pack dicom-folder ct.zarr --dry-run
  brickyard pack 'step_*.npy' flow.zarr --time-step 0.5 --time-unit s
  brickyard pack head.raw --shape 256,256,108 --dtype i16 --spacing 0.957,0.957,1.5 --unit mm head.zarr
  brickyard pack labels.tif labels.zarr --kind labels
  brickyard pack era5.nc t.zarr --variable t
  brickyard pack big.tif part.zarr --roi 0:512,0:512,0:100

Inputs, as a file, a folder of files of one format, a pattern in quotes, or a list of files:
  DICOM     a folder, the files, or one file of a series; also multi-frame files
  NIfTI     .nii, .nii.gz, .hdr with .img
  NumPy     .npy, .npz
  TIFF      .tif, .tiff, of one page or several; also of OME (.companion.ome), ImageJ, MetaMorph, BigTIFF
  pictures  .png, .jpg, .bmp: a folder, a pattern or a list of slices
  VTK       .vti, .vtk of structured points, .pvd with its files
  HDF5      .h5, .nxs, .ims, .xml of BigDataViewer; NetCDF and MINC: .nc, .mnc (--variable)
  others    .nrrd, .nhdr, .mha, .mhd, .mrc, .map, .bov, .hdr of ENVI
  raw       .raw, .bin, .dat or any other file, with --shape and --dtype";

pub(crate) const APPEND: &str = "\
Examples:
  brickyard append flow.zarr step_0001.npy
  brickyard append flow.zarr step_*.npy --time-step 0.5 --time-unit s";

pub(crate) const EDIT: &str = "\
Examples:
  brickyard edit scan.zarr --spacing 0.5,0.5,2 --unit um
  brickyard edit cells.zarr --channel-name 0=DAPI --channel-color 0=blue --dry-run
  brickyard edit flow.zarr --time-step 0.5 --time-unit s";

pub(crate) const INDEX: &str = "\
Examples:
  brickyard index cells.ome.zarr
  brickyard index plate.ome.zarr::B/3/0
  brickyard index scan.zarr";

pub(crate) const UPGRADE: &str = "\
Examples:
  brickyard upgrade scan.zarr
  brickyard upgrade scan.zarr --ngff 0.5 --dry-run";

pub(crate) const INFO: &str = "\
Examples:
  brickyard info scan.zarr
  brickyard info scan.zarr --json";

pub(crate) const PROBE: &str = "\
Examples:
  brickyard probe scan.zarr 120,120,80
  brickyard probe flow.zarr 48,48,48 --time all";

pub(crate) const VERIFY: &str = "\
Examples:
  brickyard verify scan.zarr
  brickyard verify scan.zarr --repair scan.nii.gz";

pub(crate) const EXPORT: &str = "\
Examples:
  brickyard export scan.zarr scan.nii.gz
  brickyard export scan.zarr coarse.npy --level 2
  brickyard export cells.zarr cells.tif --channel all --time all";

pub(crate) const MESH: &str = "\
Examples:
  brickyard mesh ct.zarr skull.stl --isovalue 300
  brickyard mesh ct.zarr skull.ply --isovalue 300 --smooth 5 --level 1
  brickyard mesh cells.zarr cells.glb --label all --smooth 10";

#[cfg(feature = "viewer")]
pub(crate) const VIEW: &str = "\
Examples:
  brickyard view scan.zarr
  brickyard view scan.nii.gz
  brickyard view ct.zarr --transfer ct-bone";

pub(crate) const RENDER: &str = "\
Examples:
  brickyard render scan.zarr -o scan.png
  brickyard render ct.zarr --transfer ct-bone --view left -o bone.png
  brickyard render scan.zarr --slice axial=50% -o slice.png
  brickyard render cells.zarr --mode mip --channel DAPI,actin -o cells.png
  brickyard render scan.zarr --orbit 72 --movie turn.mp4
  brickyard render flow.zarr --time all --movie flow.gif --rate 12";

pub(crate) const SYNTH: &str = "\
Examples:
  brickyard synth ct --shape 512,512,512 ct.zarr
  brickyard synth flow --shape 96,96,96 --steps 20 flow.zarr";

pub(crate) const BENCH: &str = "\
Examples:
  brickyard bench scan.zarr
  brickyard bench flow.zarr --scenario play --rate 20";

pub(crate) const QUALITY: &str = "\
Example:
  brickyard quality scan.zarr -o quality";

pub(crate) const CACHE: &str = "\
Examples:
  brickyard cache info
  brickyard cache clear";

pub(crate) const DOCTOR: &str = "\
Example:
  brickyard doctor";

pub(crate) const COMPLETIONS: &str = "\
Examples:
  brickyard completions bash > ~/.local/share/bash-completion/completions/brickyard
  brickyard completions zsh > ~/.zfunc/_brickyard
  brickyard completions fish > ~/.config/fish/completions/brickyard.fish";

pub(crate) const MAN: &str = "\
Example:
  brickyard man ~/.local/share/man/man1";

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Arguments;
    use clap::Parser;

    #[test]
    fn examples_are_commands_that_there_are() {
        let all = [
            PACK,
            APPEND,
            EDIT,
            INDEX,
            INFO,
            PROBE,
            VERIFY,
            EXPORT,
            MESH,
            RENDER,
            SYNTH,
            BENCH,
            QUALITY,
            CACHE,
            DOCTOR,
            COMPLETIONS,
            MAN,
        ];
        #[cfg(feature = "viewer")]
        let all = [&all[..], &[VIEW]].concat();
        for line in all.iter().flat_map(|text| text.lines()).filter(|line| line.starts_with("  brickyard ")) {
            // The shell's redirection is not part of the command.
            let line = line.split(" > ").next().unwrap();
            let words = line.split_whitespace().map(|word| word.trim_matches('\''));
            assert!(Arguments::try_parse_from(words).is_ok(), "{line}");
        }
    }
}
