//! The SSIM variants and the choices that define them: window, border, covariance, channels and range.

/// A variant of SSIM that public code computes; each has its own [`SsimForm`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum SsimVariant {
    Gauss11Valid,
    Gauss11Zero,
    Gauss11Reflect,
    Uniform7Sample,
    Uniform7Population,
    Gauss11ValidSample,
    Gauss11ValidGray,
    Gauss11ReflectDataRange,
    Gauss11ValidDataRange,
    Gauss11ValidBounded,
    Gauss11ZeroGuarded,
    /// Uses only windows that are entirely inside a mask; undefined without a mask.
    Gauss11ValidWholeWindow,
}

/// The choices that define an SSIM variant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SsimForm {
    pub window: SsimWindow,
    pub border: SsimBorder,
    pub covariance: SsimCovariance,
    /// Computed on luma 0.299 R + 0.587 G + 0.114 B instead of each channel.
    pub gray: bool,
    /// The data range is the larger of the two pictures' maximum minus minimum, instead of 1.
    pub range_of_data: bool,
    /// 1e-8 is added to the denominator, whose minimum is 9e-8. This lowers values in dark flat
    /// areas by a tenth.
    pub guarded: bool,
    /// With a mask, only windows entirely inside the mask are used, instead of all windows whose centre is inside.
    pub whole_windows: bool,
}

/// Weights of the pixels around a centre.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SsimWindow {
    /// Gaussian, 11 taps, σ 1.5.
    Gauss11,
    /// 7×7 box.
    Uniform7,
}

/// Treatment of windows that extend beyond the picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SsimBorder {
    /// Windows that extend beyond the picture are skipped: the map is smaller than the picture by a radius on each
    /// side.
    Valid,
    /// The picture is padded with zeros.
    Zero,
    /// The picture is mirrored without repeating the edge pixel.
    Reflect,
}

/// Estimator of variances and covariances from the moments in the window.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SsimCovariance {
    Population,
    /// Sample covariance: multiplied by n / (n − 1) for the n pixels of the window.
    Sample,
    /// Population covariance with variances of at least f32's ε squared and covariances of at most √(σₐ² σᵦ²), as in
    /// dm_pix.
    Bounded,
}

impl SsimVariant {
    /// All variants, the default first.
    pub const ALL: [Self; 12] = [
        Self::Gauss11Valid,
        Self::Gauss11Zero,
        Self::Gauss11Reflect,
        Self::Uniform7Sample,
        Self::Uniform7Population,
        Self::Gauss11ValidSample,
        Self::Gauss11ValidGray,
        Self::Gauss11ReflectDataRange,
        Self::Gauss11ValidDataRange,
        Self::Gauss11ValidBounded,
        Self::Gauss11ZeroGuarded,
        Self::Gauss11ValidWholeWindow,
    ];

    pub fn form(self) -> SsimForm {
        let mut form = SsimForm {
            window: SsimWindow::Gauss11,
            border: SsimBorder::Valid,
            covariance: SsimCovariance::Population,
            gray: false,
            range_of_data: false,
            guarded: false,
            whole_windows: false,
        };
        match self {
            Self::Gauss11Valid => {}
            Self::Gauss11Zero => form.border = SsimBorder::Zero,
            Self::Gauss11Reflect => form.border = SsimBorder::Reflect,
            Self::Uniform7Sample => {
                form.window = SsimWindow::Uniform7;
                form.covariance = SsimCovariance::Sample;
            }
            Self::Uniform7Population => form.window = SsimWindow::Uniform7,
            Self::Gauss11ValidSample => form.covariance = SsimCovariance::Sample,
            Self::Gauss11ValidGray => form.gray = true,
            Self::Gauss11ReflectDataRange => {
                form.border = SsimBorder::Reflect;
                form.range_of_data = true;
            }
            Self::Gauss11ValidDataRange => form.range_of_data = true,
            Self::Gauss11ValidBounded => form.covariance = SsimCovariance::Bounded,
            Self::Gauss11ZeroGuarded => {
                form.border = SsimBorder::Zero;
                form.guarded = true;
            }
            Self::Gauss11ValidWholeWindow => form.whole_windows = true,
        }
        form
    }

    /// Text between the key's brackets: window, border, covariance, and any other differences from the default.
    pub(crate) fn text(self) -> String {
        let form = self.form();
        let mut parts = match (form.window, form.covariance) {
            (SsimWindow::Uniform7, SsimCovariance::Population) => vec!["uniform7", "population"],
            (SsimWindow::Uniform7, _) => vec!["uniform7"],
            (SsimWindow::Gauss11, _) => vec![
                "gauss11",
                match form.border {
                    SsimBorder::Valid => "valid",
                    SsimBorder::Zero => "zero",
                    SsimBorder::Reflect => "reflect",
                },
            ],
        };
        let rest = [
            (form.covariance == SsimCovariance::Sample, "sample"),
            (form.covariance == SsimCovariance::Bounded, "cov=bounded"),
            (form.gray, "gray"),
            (form.range_of_data, "range=data"),
            (form.guarded, "eps=1e-8"),
            (form.whole_windows, "mask=window"),
        ];
        parts.extend(rest.into_iter().filter(|(is, _)| *is).map(|(_, text)| text));
        parts.join(",")
    }
}
