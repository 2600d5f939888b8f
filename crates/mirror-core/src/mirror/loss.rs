//! The loss of a residual: squared, or with less weight where it is large (robust).

use crate::error::{Result, positive};

/// The loss of one corner's residual, a function of its length over the noise's standard deviation, `r = |e|/σ`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Loss {
    /// `r²`: right for normal noise alone.
    #[default]
    Squared,
    /// `r²` up to the threshold k, `2 k r − k²` beyond: bounded influence (Huber 1964).
    Huber {
        /// k, in standard deviations of one axis.
        threshold: f64,
    },
    /// `k² ln(1 + r²/k²)`: influence that falls again, for gross outliers.
    Cauchy {
        /// k, in standard deviations of one axis.
        threshold: f64,
    },
}

/// What a loss makes of one residual, all in px² or unitless.
pub(crate) struct Weighed {
    /// The loss, px².
    pub cost: f64,
    /// `ψ(e) = weight · e`.
    pub weight: f64,
    /// Half the trace of `∂ψ/∂e`: for the covariance of an M-estimate.
    pub slope: f64,
}

impl Loss {
    /// Huber's loss at 2 σ: of a two-dimensional normal residual, 86 % count in full.
    pub fn huber() -> Self {
        Self::Huber { threshold: 2.0 }
    }

    /// Cauchy's loss at 3 σ.
    pub fn cauchy() -> Self {
        Self::Cauchy { threshold: 3.0 }
    }

    /// The loss of a name, with its usual threshold: `squared`, `huber` or `cauchy`.
    ///
    /// # Errors
    /// [`crate::Error::UnknownName`], with the valid names.
    pub fn from_name(name: &str) -> Result<Self> {
        match name {
            "squared" => Ok(Self::Squared),
            "huber" => Ok(Self::huber()),
            "cauchy" => Ok(Self::cauchy()),
            _ => Err(crate::Error::UnknownName {
                what: "loss",
                got: name.to_owned(),
                valid: "squared, huber, cauchy".to_owned(),
            }),
        }
    }

    pub(crate) fn validated(self) -> Result<Self> {
        if let Self::Huber { threshold } | Self::Cauchy { threshold } = self {
            positive("threshold of the loss (standard deviations)", threshold)?;
        }
        Ok(self)
    }

    #[inline]
    pub(crate) fn weigh(&self, squared_px2: f64, noise_px: f64) -> Weighed {
        match *self {
            Self::Squared => Weighed { cost: squared_px2, weight: 1.0, slope: 1.0 },
            Self::Huber { threshold } => {
                let k = threshold * noise_px;
                if squared_px2 <= k * k {
                    Weighed { cost: squared_px2, weight: 1.0, slope: 1.0 }
                } else {
                    let r = squared_px2.sqrt();
                    Weighed { cost: k * (2.0 * r - k), weight: k / r, slope: 0.5 * k / r }
                }
            }
            Self::Cauchy { threshold } => {
                let k2 = (threshold * noise_px).powi(2);
                let weight = 1.0 / (1.0 + squared_px2 / k2);
                let slope = weight - squared_px2 / k2 * weight * weight;
                Weighed { cost: k2 * (squared_px2 / k2).ln_1p(), weight, slope }
            }
        }
    }
}
