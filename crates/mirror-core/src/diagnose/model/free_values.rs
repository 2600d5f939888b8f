//! Parameters of the free-form errors of lens, board and mirror, and the index of each ([`super::free_optics`] has
//! their equations).

use crate::diagnose::principles::Size;
use nalgebra::SVector;

/// Monomials of the image's warp in each of u and v.
pub(crate) const MONOMIALS: Size = 9;
/// Numbers of the lens' warp, of the board's shape and of the mirror's astigmatism.
pub(crate) const WARP: core::ops::Range<usize> = 0..2 * MONOMIALS;
pub(crate) const BOARD_SHAPE: core::ops::Range<usize> = WARP.end..WARP.end + 5;
pub(crate) const ASTIGMATISM: core::ops::Range<usize> = BOARD_SHAPE.end..BOARD_SHAPE.end + 2;
/// Values of all free-form errors of the optics.
pub(crate) type FreeValues = SVector<f64, { ASTIGMATISM.end }>;
