//! The losses of the paper's §3.3 and §3.4, each a pure function that returns its value and its gradient.
