//! Tests pinning in a process of its own.

use sharp_kernels::{InstructionSet, PinError, Simd};

#[test]
fn a_pin_comes_before_detection_and_holds() {
    let wanted = InstructionSet::Portable;
    let pinned = Simd::pin(wanted).unwrap();
    assert_eq!(Simd::detect(), pinned);
    assert_eq!(pinned.instruction_set(), wanted);
    assert_eq!(Simd::pin(wanted), Ok(pinned));
    for simd in Simd::available().into_iter().filter(|&simd| simd != pinned) {
        let error = PinError::InUse {
            wanted: simd.instruction_set(),
            in_use: wanted,
        };
        assert_eq!(Simd::pin(simd.instruction_set()), Err(error));
    }
    assert_eq!(Simd::detect(), pinned);
}
