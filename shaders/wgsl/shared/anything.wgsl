// The range of codes that tells nothing: samples may be past its ends, too.
const ANYTHING: u32 = 0xffff0000u;
