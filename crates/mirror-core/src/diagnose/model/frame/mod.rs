//! One frame of the exact forward model: predictions, residuals and the rows of any column, with the mirror
//! projected out.
//!
//! For a given deformation the frame's mirror plane is fitted to everything that the frame shows (variable
//! projection); then the model is linearised there. With rows whitened, plane rows D, `G = DᵀD = L Lᵀ`, a column x
//! enters the reduced normal equations as `⟨x, y⟩ = x·y − (L⁻¹Dᵀx)·(L⁻¹Dᵀy)`: each vector is stored as its rows
//! followed by the three numbers `L⁻¹Dᵀx`.

mod board_fit;
mod columns;
mod condensed;
mod condensing;
mod corners;
mod many_columns;
mod many_corners;
mod many_markers;
mod marker_sights;
mod mirror_and_lens;
mod observe;
mod pictures;
mod plane_of_frame;
mod plane_start;
mod products;
mod rows;
mod sight;
mod target;
#[cfg(test)]
mod tests;
mod work;

pub(crate) use board_fit::FEWEST_CORNERS;
pub(crate) use corners::SeenCorner;
pub(crate) use many_columns::{Acting, ManyColumns};
pub(crate) use products::{LANES, PROJECTED, Table, add_products, stride};
pub(crate) use sight::Wanted;
pub(crate) use work::{FrameWork, Task};
