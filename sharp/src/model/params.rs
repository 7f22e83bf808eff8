//! Parameters of a network and the source of their values.
//!
//! Modules declare their parameters by name and shape while they are built, and fetch the values
//! when they run. On the CPU each layer's weights are packed just before their one use in a
//! prediction and dropped after it, so that a network of 2.8 GB takes a few megabytes of weights.

use std::cell::RefCell;

use super::ModelError;

/// Gives the values of parameters.
pub trait WeightSource: Send + Sync {
    /// The values of the parameter called `name` of `shape`, in C order of PyTorch's layout.
    ///
    /// # Errors
    /// [`ModelError`] when they cannot be read.
    fn values(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>, ModelError>;
}

/// One parameter of a network.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Parameter {
    /// As in the checkpoint.
    pub name: String,
    /// As PyTorch lays it out.
    pub shape: Vec<usize>,
    /// False for what is in the checkpoint but never used at inference.
    pub used: bool,
}

impl Parameter {
    pub fn len(&self) -> usize {
        self.shape.iter().product()
    }

    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// A place in the tree of modules under construction; collects what they declare.
#[derive(Clone)]
pub(super) struct Params<'a> {
    list: &'a RefCell<Vec<Parameter>>,
    path: String,
}

impl<'a> Params<'a> {
    pub(super) fn new(list: &'a RefCell<Vec<Parameter>>) -> Self {
        Self {
            list,
            path: String::new(),
        }
    }

    /// The module `name` below this one.
    pub(super) fn pp(&self, name: impl std::fmt::Display) -> Self {
        Self {
            list: self.list,
            path: self.name(name),
        }
    }

    pub(super) fn get(&self, name: &str, shape: &[usize]) -> Parameter {
        self.declare(name, shape, true)
    }

    /// Declares a parameter of this module that inference does not use.
    pub(super) fn unused(&self, name: &str, shape: &[usize]) {
        self.declare(name, shape, false);
    }

    fn declare(&self, name: &str, shape: &[usize], used: bool) -> Parameter {
        let parameter = Parameter {
            name: self.name(name),
            shape: shape.to_vec(),
            used,
        };
        self.list.borrow_mut().push(parameter.clone());
        parameter
    }

    fn name(&self, name: impl std::fmt::Display) -> String {
        if self.path.is_empty() {
            name.to_string()
        } else {
            format!("{}.{name}", self.path)
        }
    }
}
