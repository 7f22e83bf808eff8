//! A pickle interpreter that knows just what a state dict of PyTorch needs.
//!
//! Values live in flat arenas and refer to each other by number, so that neither deep nesting
//! nor cycles can overflow the stack, and an opcode costs a bounded amount of memory. Nothing
//! is ever called: the handful of constructors a state dict names are recognised, everything
//! else is a name in place of what it would make. Tensors that need one are not there.
//!
//! * [`machine`]: the opcodes.
//! * [`value`]: what is on the stack, and the arenas.
//! * [`construct`]: the constructors that are known.
//! * [`state_dict`]: from the pickled object to named tensors.

mod construct;
mod machine;
pub(crate) mod state_dict;
pub(crate) mod value;

pub(crate) use machine::{MAX_LEN, load};
