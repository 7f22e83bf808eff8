//! Position within a training.

use std::fmt;

/// The paper's two stages, in their order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Stage {
    /// Scenes with true depth.
    Supervised,
    /// Photographs without depth, against pseudo-novel views (SSFT).
    SelfSupervised,
}

impl Stage {
    pub const ALL: [Self; 2] = [Self::Supervised, Self::SelfSupervised];

    /// 1 or 2.
    pub fn number(self) -> u64 {
        match self {
            Self::Supervised => 1,
            Self::SelfSupervised => 2,
        }
    }

    /// The stage of a [`Self::number`].
    pub fn from_number(number: u64) -> Option<Self> {
        Self::ALL.into_iter().find(|stage| stage.number() == number)
    }
}

/// Ordered in time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Position {
    pub stage: Stage,
    /// Steps made in this stage.
    pub step: u64,
}

impl Position {
    /// Before the first step.
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
