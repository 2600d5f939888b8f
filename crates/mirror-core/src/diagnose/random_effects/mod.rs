//! Gaussian random effects: discrepancy of laws, geometric tolerances, free forms.

pub(super) mod column_law;
pub(super) mod displaced;
pub(super) mod free_form;
pub(super) mod geometric_tolerances;
pub(super) mod law_columns;
pub(super) mod law_discrepancy;
pub(super) mod outlier_tolerances;
pub(super) mod small_errors;
