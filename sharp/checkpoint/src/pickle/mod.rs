//! A pickle interpreter that supports only what a PyTorch state dict needs.
//!
//! Values are stored in flat arenas and refer to each other by index. Therefore, neither deep nesting nor cycles can
//! overflow the stack, and each opcode uses a bounded amount of memory. Nothing is ever called: the few constructors
//! used by state dicts are recognised, and any other call yields a placeholder with the function's name. Tensors that
//! depend on a placeholder are omitted.
//!
//! * [`machine`]: the opcodes.
//! * [`value`]: values on the stack, and the arenas.
//! * [`construct`]: the supported constructors.
//! * [`state_dict`]: conversion of the pickled object to named tensors.

mod construct;
mod machine;
pub(crate) mod state_dict;
pub(crate) mod value;

pub(crate) use machine::load;
