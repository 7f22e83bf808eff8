use crate::losses::TERMS;

/// Losses of an example, or their sum over a step.
#[derive(Default)]
pub(super) struct StepSum {
    pub(super) terms: [f64; TERMS.len()],
    pub(super) total: f64,
    /// Gradients of the loss, one element per trained parameter.
    pub(super) gradients: Vec<Vec<f32>>,
}

impl StepSum {
    pub(super) fn add(&mut self, example: Self) {
        self.total += example.total;
        for (sum, term) in self.terms.iter_mut().zip(example.terms) {
            *sum += term;
        }
        if self.gradients.is_empty() {
            self.gradients = example.gradients;
            return;
        }
        let gradients = self.gradients.iter_mut().flatten();
        let added = example.gradients.iter().flatten();
        gradients.zip(added).for_each(|(sum, g)| *sum += g);
    }

    /// Description of the first quantity that is not finite.
    pub(super) fn not_finite(&self) -> Option<&'static str> {
        if !self.total.is_finite() {
            return Some("the loss");
        }
        let mut gradients = self.gradients.iter().flatten();
        let is_finite = gradients.all(|g| g.is_finite());
        (!is_finite).then_some("the gradient")
    }

    pub(super) fn divide_by(&mut self, batch: usize) {
        let share = 1.0 / batch as f64;
        self.total *= share;
        self.terms.iter_mut().for_each(|term| *term *= share);
        if batch > 1 {
            let all = self.gradients.iter_mut().flatten();
            all.for_each(|g| *g *= share as f32);
        }
    }
}
