//! Files as memory, for readers of sources and of stores alike: [`GuardedMap`].

mod guarded_map;

pub use guarded_map::GuardedMap;
