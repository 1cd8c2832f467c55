//! Files as memory, for readers of sources and of stores: [`GuardedMap`].

mod guarded_map;

pub use guarded_map::GuardedMap;
