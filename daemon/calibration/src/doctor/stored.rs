//! How matrices are stored.

use lantern_config::{Matrices, Matrix4, Order};

use super::{Ailment, Finding};

/// Matrices of which one at least is certainly stored the other way.
pub(super) fn transposed(matrices: &Matrices) -> Option<Finding> {
    let (projection, view) = (order_of(&matrices.projection), order_of(&matrices.view));
    let other = match matrices.order {
        Order::Row => "column",
        Order::Column => "row",
    };
    let (key, message, hint) = match (projection, view) {
        // One key tells the order of both, so it is the remedy where none of the two speaks against it.
        (Some(Order::Column) | None, Some(Order::Column)) => (
            "view",
            format!("looks transposed: the translation is in the last row; set order = \"{other}\""),
            "the translation stands in the last column of a matrix that is written row by row".to_owned(),
        ),
        (Some(Order::Column), None) => (
            "projection",
            format!("looks transposed: the perspective is in the last column; set order = \"{other}\""),
            "the perspective, 0 0 -1 0 or 0 0 1 0, is the last row of a matrix that is written row by row".to_owned(),
        ),
        (Some(Order::Row), Some(Order::Column)) => (
            "view",
            "`view` looks transposed: the translation is in the last row".to_owned(),
            "write it in the order of `projection`, which is not transposed".to_owned(),
        ),
        (Some(Order::Column), Some(Order::Row)) => (
            "projection",
            "`projection` looks transposed: the perspective is in the last column".to_owned(),
            "write it in the order of `view`, which is not transposed".to_owned(),
        ),
        (Some(Order::Row) | None, Some(Order::Row) | None) => return None,
    };
    Some(Finding { ailment: Ailment::Transposed, certain: true, key, message, hint })
}

/// The order in which a matrix that is read by rows must have been stored, where its zeros tell it. Those of a keystoned
/// matrix, or of a product, do not, and neither do those of a matrix that is its own transpose.
fn order_of(matrix: &Matrix4) -> Option<Order> {
    let column = |j: usize| matrix.map(|row| row[j]);
    let (row, column) = (matrix[3], column(3));
    let is_affine = |last: [f64; 4]| last == [0.0, 0.0, 0.0, 1.0];
    let is_perspective = |last: [f64; 4]| last[0] == 0.0 && last[1] == 0.0 && last[3] == 0.0 && last[2].abs() == 1.0;
    // What the other end of the matrix has where this one is in its place: a translation, or near and far.
    let has_rest = |last: [f64; 4]| last[..3].iter().any(|entry| *entry != 0.0);
    let is_depth = |last: [f64; 4]| last[0] == 0.0 && last[1] == 0.0 && last[3] == 0.0 && last[2].abs() != 1.0;
    if (is_affine(row) && has_rest(column)) || (is_perspective(row) && !is_perspective(column)) {
        return Some(Order::Row);
    }
    // A lens shift stands in the third column where the matrix is read as it was stored.
    let is_shifted = matrix[0][2] != 0.0 || matrix[1][2] != 0.0;
    if (is_affine(column) && has_rest(row)) || (is_perspective(column) && is_depth(row) && !is_shifted) {
        return Some(Order::Column);
    }
    None
}
