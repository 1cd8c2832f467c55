// The range of codes without information: samples may be past its ends, too.
const ANYTHING: u32 = 0xffff0000u;
