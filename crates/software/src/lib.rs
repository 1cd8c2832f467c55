//! The CPU renderer: the same draw list over slots in RAM, all cores.
