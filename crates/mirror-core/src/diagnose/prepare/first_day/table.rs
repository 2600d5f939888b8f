//! Rows of one length in one piece of memory: alternatives are tried on copies of a session's rows, and a copy is one
//! allocation, however many rows there are.

use core::ops::{Index, IndexMut, Range};

/// Rows of one length.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Table<T> {
    values: Vec<T>,
    rows: usize,
    width: usize,
}

impl<T: Copy> Table<T> {
    /// The rows of an iterator, all as long as the first.
    pub fn of<R: AsRef<[T]>>(rows: impl IntoIterator<Item = R>) -> Self {
        let mut table = Self { values: Vec::new(), rows: 0, width: 0 };
        for row in rows {
            table.width = row.as_ref().len();
            table.values.extend_from_slice(row.as_ref());
            table.rows += 1;
        }
        debug_assert_eq!(table.values.len(), table.rows * table.width, "rows of different lengths");
        table
    }

    /// How many rows.
    pub fn len(&self) -> usize {
        self.rows
    }

    /// How long each is.
    pub fn width(&self) -> usize {
        self.width
    }

    /// The rows in their order.
    pub fn iter(&self) -> impl Iterator<Item = &[T]> {
        (0..self.rows).map(|row| &self[row])
    }

    /// The rows in their order, to change.
    pub fn iter_mut(&mut self) -> impl Iterator<Item = &mut [T]> {
        self.range_mut(0..self.rows)
    }

    /// Some of the rows, to change.
    pub fn range_mut(&mut self, rows: Range<usize>) -> impl Iterator<Item = &mut [T]> {
        let values = rows.start * self.width..rows.end * self.width;
        // Rows of nothing have nothing to change.
        self.values[values].chunks_exact_mut(self.width.max(1))
    }
}

impl<T> Index<usize> for Table<T> {
    type Output = [T];

    fn index(&self, row: usize) -> &[T] {
        &self.values[row * self.width..(row + 1) * self.width]
    }
}

impl<T> IndexMut<usize> for Table<T> {
    fn index_mut(&mut self, row: usize) -> &mut [T] {
        &mut self.values[row * self.width..(row + 1) * self.width]
    }
}

#[cfg(test)]
mod tests {
    use crate::diagnose::prepare::first_day::table::Table;

    #[test]
    fn rows_are_as_they_were_given() {
        let rows = [[1, 2, 3], [4, 5, 6], [7, 8, 9]];
        let mut table = Table::of(rows);
        assert_eq!((table.len(), table.width()), (3, 3));
        assert!(table.iter().eq(rows.iter().map(|row| row.as_slice())));
        table.range_mut(1..3).for_each(|row| row[0] = 0);
        table[0][2] = 8;
        assert_eq!(table, Table::of([[1, 2, 8], [0, 5, 6], [0, 8, 9]]));
        let mut empty = Table::of([[0_u8; 0]; 4]);
        assert_eq!((empty.len(), empty.iter().count(), empty.iter_mut().count()), (4, 4, 0));
    }
}
