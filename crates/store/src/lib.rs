//! The brick store: an OME-Zarr 0.5 image with side data; pack, open, read, verify, export.
