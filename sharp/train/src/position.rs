//! Stage and step of a training run.

use std::fmt;

/// The paper's two stages, in order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Stage {
    /// Training on scenes with true depth.
    Supervised,
    /// Self-supervised fine-tuning (SSFT): photographs without depth, with pseudo-novel views.
    SelfSupervised,
}

impl Stage {
    pub const ALL: [Self; 2] = [Self::Supervised, Self::SelfSupervised];

    /// Number of the stage, 1 or 2.
    pub fn number(self) -> u64 {
        match self {
            Self::Supervised => 1,
            Self::SelfSupervised => 2,
        }
    }

    /// Inverse of [`Self::number`].
    pub fn from_number(number: u64) -> Option<Self> {
        Self::ALL.into_iter().find(|stage| stage.number() == number)
    }
}

/// A point in a training run: the stage and the steps completed in it. Ordered by time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Position {
    pub stage: Stage,
    /// Steps completed in this stage.
    pub step: u64,
}

impl Position {
    /// Position before the first step.
    pub const START: Self = Self {
        stage: Stage::Supervised,
        step: 0,
    };
}

impl fmt::Display for Position {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "stage {}, step {}", self.stage.number(), self.step)
    }
}
