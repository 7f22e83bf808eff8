//! Losses as functions of plain slices, each with its gradient (paper section 3.4).
