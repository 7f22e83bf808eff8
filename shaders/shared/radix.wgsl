// Shared by both halves of a radix pass: 8 bits per pass, blocks of 4096 keys.

struct RadixParams {
    count: u32,
    shift: u32,
    blocks: u32,
    // 1 in the first pass, whose values are the indices themselves.
    identity: u32,
}

const DIGITS: u32 = 256u;
const ROUNDS: u32 = 16u;

fn digit_of(key: u32, shift: u32) -> u32 {
    return (key >> shift) & 0xffu;
}
