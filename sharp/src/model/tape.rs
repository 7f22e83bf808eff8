//! The record of a forward pass on the kernels from which gradients are computed.
//!
//! Every layer that gradients have to pass adds a node: how the gradient of its output becomes those of
//! its inputs and parameters. Nodes are in order of computation, so that backwards each comes after
//! everything that used it.

use std::collections::BTreeMap;
use std::fmt;
use std::sync::{Arc, Mutex, PoisonError, Weak};

use rayon::prelude::*;
use sharp_kernels::Workspace;

use super::ModelError;

/// From the gradient of an output to those of what it was made from.
type Backward = Box<dyn FnOnce(Vec<f32>, &mut Gradients) -> Result<(), ModelError> + Send>;

/// The nodes of one pass.
pub(super) struct Tape {
    trainable: Box<dyn Fn(&str) -> bool + Send + Sync>,
    /// See [`TrainingInput`](super::training::TrainingInput).
    zeros_return: bool,
    /// `None` for what gradients end at.
    nodes: Mutex<Vec<Option<Backward>>>,
}

/// A place on a tape, which nodes do not keep: their own tape holds them.
#[derive(Clone)]
pub(super) struct Node {
    tape: Weak<Tape>,
    pub(super) index: usize,
}

impl fmt::Debug for Node {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "node {}", self.index)
    }
}

/// Sums of gradients on their way back.
#[derive(Default)]
pub(super) struct Gradients {
    /// By node, in its map's layout.
    maps: BTreeMap<usize, Vec<f32>>,
    /// By name, as PyTorch lays them out.
    pub(super) parameters: BTreeMap<String, Vec<f32>>,
    pub(super) workspace: Workspace,
}

impl Tape {
    /// `trainable` tells by name which parameters want gradients.
    pub(super) fn new(
        trainable: impl Fn(&str) -> bool + Send + Sync + 'static,
        zeros_return: bool,
    ) -> Arc<Self> {
        Arc::new(Self {
            trainable: Box::new(trainable),
            zeros_return,
            nodes: Mutex::default(),
        })
    }

    pub(super) fn trains(&self, parameter: &str) -> bool {
        (self.trainable)(parameter)
    }

    /// A place where gradients end and can be read.
    pub(super) fn leaf(self: &Arc<Self>) -> Node {
        self.push(None)
    }

    pub(super) fn record(
        self: &Arc<Self>,
        backward: impl FnOnce(Vec<f32>, &mut Gradients) -> Result<(), ModelError> + Send + 'static,
    ) -> Node {
        self.push(Some(Box::new(backward)))
    }

    fn push(self: &Arc<Self>, backward: Option<Backward>) -> Node {
        let mut nodes = self.nodes.lock().unwrap_or_else(PoisonError::into_inner);
        nodes.push(backward);
        Node {
            tape: Arc::downgrade(self),
            index: nodes.len() - 1,
        }
    }

    /// Goes back from the last node to `first`, and forgets these nodes.
    pub(super) fn backward(
        &self,
        first: usize,
        gradients: &mut Gradients,
    ) -> Result<(), ModelError> {
        loop {
            let mut nodes = self.nodes.lock().unwrap_or_else(PoisonError::into_inner);
            if nodes.len() <= first {
                return Ok(());
            }
            let (backward, index) = (nodes.pop().flatten(), nodes.len());
            drop(nodes);
            if let Some(backward) = backward
                && let Some(gradient) = gradients.maps.remove(&index)
            {
                backward(gradient, gradients)?;
            }
        }
    }
}

impl Node {
    /// Whether disparity that has become zero lets gradients pass that would raise it.
    pub(super) fn zeros_return(&self) -> bool {
        self.tape.upgrade().is_some_and(|tape| tape.zeros_return)
    }

    /// As [`Tape::record`], on this node's tape while there is one.
    pub(super) fn record(
        &self,
        backward: impl FnOnce(Vec<f32>, &mut Gradients) -> Result<(), ModelError> + Send + 'static,
    ) -> Self {
        match self.tape.upgrade() {
            Some(tape) => tape.record(backward),
            None => self.clone(),
        }
    }
}

impl Gradients {
    /// Adds to a node's gradient; what has no node has no use for it.
    pub(super) fn add(&mut self, node: Option<&Node>, gradient: Vec<f32>) {
        let Some(node) = node else {
            return;
        };
        match self.maps.get_mut(&node.index) {
            Some(sum) => add_to(sum, &gradient),
            None => {
                self.maps.insert(node.index, gradient);
            }
        }
    }

    /// Adds to a part of a node's gradient, which has `total` values in all.
    pub(super) fn add_part(&mut self, node: &Node, total: usize, first: usize, part: &[f32]) {
        let whole = self.maps.entry(node.index);
        let whole = whole.or_insert_with(|| vec![0.0; total]);
        add_to(&mut whole[first..first + part.len()], part);
    }

    /// What has arrived at a node.
    pub(super) fn take(&mut self, node: &Node) -> Option<Vec<f32>> {
        self.maps.remove(&node.index)
    }

    pub(super) fn add_parameter(&mut self, name: &str, gradient: Vec<f32>) {
        match self.parameters.get_mut(name) {
            Some(sum) => add_to(sum, &gradient),
            None => {
                self.parameters.insert(name.to_owned(), gradient);
            }
        }
    }
}

fn add_to(sum: &mut [f32], part: &[f32]) {
    const CHUNK: usize = 1 << 16;
    let parts = sum.par_chunks_mut(CHUNK).zip(part.par_chunks(CHUNK));
    parts.for_each(|(sum, part)| {
        for (sum, v) in sum.iter_mut().zip(part) {
            *sum += v;
        }
    });
}
