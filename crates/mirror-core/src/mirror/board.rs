//! The chessboard and what a picture shows of it.

use crate::error::{Error, Result, finite, positive};
use nalgebra::{Point2, Point3, Vector2};

/// Four points are the fewest that determine the pose of a plane.
pub const FEWEST_CORNERS: usize = 4;
/// Corners whose spread across their main line is below this share of the spread along it lie on one line.
const LINE_RATIO: f64 = 1e-9;

/// A chessboard: its inner corners and the side of its squares.
///
/// Corner `index = iy nx + ix` lies at `((ix − (nx−1)/2) s, (iy − (ny−1)/2) s, 0)` in the board frame: origin at the
/// centre, x and y in the plane, z out of the printed face.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Board {
    corners: (usize, usize),
    square_m: f64,
}

/// Inner corners along an axis at most: no board has more, and their number must stay countable.
const MOST_CORNERS: usize = 10_000;

impl Board {
    /// A board of `(nx, ny)` inner corners with squares of the given side (m).
    ///
    /// # Errors
    /// [`Error::OutOfRange`]: fewer than 2 or more than 10,000 corners along an axis, or a side that is not above zero.
    pub fn new(corners: (usize, usize), square_m: f64) -> Result<Self> {
        for (name, n) in [("x", corners.0), ("y", corners.1)] {
            if n < 2 {
                return Err(Error::OutOfRange {
                    what: format!("inner corners along {name}"),
                    got: n as f64,
                    needed: "at least 2".into(),
                });
            }
            if n > MOST_CORNERS {
                return Err(Error::OutOfRange {
                    what: format!("inner corners along {name}"),
                    got: n as f64,
                    needed: format!("at most {MOST_CORNERS}"),
                });
            }
        }
        positive("side of a square (m)", square_m)?;
        Ok(Self { corners, square_m })
    }

    /// Inner corners along x and y.
    pub fn corners(&self) -> (usize, usize) {
        self.corners
    }

    /// How many inner corners there are, `nx ny`.
    pub fn corner_count(&self) -> usize {
        self.corners.0 * self.corners.1
    }

    /// Side of a square, m.
    pub fn square_m(&self) -> f64 {
        self.square_m
    }

    /// Where a corner lies in the board frame (its z is 0), m.
    ///
    /// # Errors
    /// [`Error::CornerOutsideBoard`].
    pub fn corner_in_board(&self, index: usize) -> Result<Point3<f64>> {
        if index >= self.corner_count() {
            return Err(Error::CornerOutsideBoard { index, nx: self.corners.0, ny: self.corners.1 });
        }
        let at = self.place(index);
        Ok(Point3::new(at.x, at.y, 0.0))
    }

    /// All corners in the board frame, in the order of their index, m.
    pub fn corners_in_board(&self) -> Vec<Point3<f64>> {
        (0..self.corner_count()).map(|i| self.place(i)).map(|p| Point3::new(p.x, p.y, 0.0)).collect()
    }

    fn place(&self, index: usize) -> Point2<f64> {
        let (nx, ny) = self.corners;
        let centred = |i: usize, n: usize| (i as f64 - (n as f64 - 1.0) / 2.0) * self.square_m;
        Point2::new(centred(index % nx, nx), centred(index / nx, ny))
    }
}

/// A corner that a detector found, with its TRUE label: the physical corner, whatever the mirror does to the picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DetectedCorner {
    /// `iy nx + ix`.
    pub index: usize,
    /// (u, v), px.
    pub pixel: Vector2<f64>,
}

/// A corner in the board and in the picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SeenCorner {
    /// `iy nx + ix`.
    pub index: usize,
    /// x and y in the board frame, m (z is 0).
    pub point_in_board: Point2<f64>,
    /// (u, v), px.
    pub pixel: Vector2<f64>,
}

/// Whether all corners but at most one lie on one line: then a whole family of homographies fits. Such a line passes through two of any
/// three corners.
fn all_but_one_on_a_line(corners: &[SeenCorner]) -> bool {
    let [a, b, c, ..] = corners else { return true };
    let is_line = |from: &SeenCorner, to: &SeenCorner| {
        let along = to.point_in_board - from.point_in_board;
        let beside = |corner: &&SeenCorner| {
            let to_corner = corner.point_in_board - from.point_in_board;
            along.perp(&to_corner).abs() > LINE_RATIO * along.norm() * to_corner.norm()
        };
        corners.iter().filter(beside).count() < 2
    };
    is_line(a, b) || is_line(a, c) || is_line(b, c)
}

/// The corners that one picture shows, checked once: of the board, finite, unique, at least four and not on one line.
#[derive(Debug, Clone, PartialEq)]
pub struct BoardView {
    corners: Vec<SeenCorner>,
}

impl BoardView {
    /// Checks detections against their board. Some corners may be missing.
    ///
    /// # Errors
    /// [`Error::CornerOutsideBoard`], [`Error::CornerTwice`], [`Error::NotFinite`], [`Error::CornersDegenerate`].
    pub fn new(board: &Board, detections: &[DetectedCorner]) -> Result<Self> {
        let mut seen = vec![false; board.corner_count()];
        let mut corners = Vec::with_capacity(detections.len());
        for &DetectedCorner { index, pixel } in detections {
            let at = board.corner_in_board(index)?;
            if std::mem::replace(&mut seen[index], true) {
                return Err(Error::CornerTwice { index });
            }
            finite("u of a board corner (px)", pixel.x)?;
            finite("v of a board corner (px)", pixel.y)?;
            corners.push(SeenCorner { index, point_in_board: at.xy(), pixel });
        }
        Self::spread_checked(corners)
    }

    /// A view of all corners, in the order of their index.
    ///
    /// # Errors
    /// [`Error::LengthMismatch`], and as [`BoardView::new`].
    pub fn complete(board: &Board, pixels: &[Vector2<f64>]) -> Result<Self> {
        if pixels.len() != board.corner_count() {
            return Err(Error::LengthMismatch {
                what: "pixels of a complete board".into(),
                got: pixels.len(),
                needed: board.corner_count(),
            });
        }
        let mut corners = Vec::with_capacity(pixels.len());
        for (index, &pixel) in pixels.iter().enumerate() {
            finite("u of a board corner (px)", pixel.x)?;
            finite("v of a board corner (px)", pixel.y)?;
            corners.push(SeenCorner { index, point_in_board: board.place(index), pixel });
        }
        Self::spread_checked(corners)
    }

    fn spread_checked(corners: Vec<SeenCorner>) -> Result<Self> {
        let got = corners.len();
        if got < FEWEST_CORNERS {
            return Err(Error::CornersDegenerate { got, arrangement: "corners" });
        }
        let n = got as f64;
        let mean = corners.iter().fold(Vector2::zeros(), |sum, c| sum + c.point_in_board.coords) / n;
        let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
        for corner in &corners {
            let p = corner.point_in_board.coords - mean;
            xx += p.x * p.x;
            xy += p.x * p.y;
            yy += p.y * p.y;
        }
        // Determinant over squared trace: the ratio of the spreads, to first order.
        if xx * yy - xy * xy <= LINE_RATIO * (xx + yy) * (xx + yy) {
            return Err(Error::CornersDegenerate { got, arrangement: "corners on one line" });
        }
        if all_but_one_on_a_line(&corners) {
            return Err(Error::CornersDegenerate { got, arrangement: "corners, all but one on one line" });
        }
        Ok(Self { corners })
    }

    /// The corners.
    pub fn corners(&self) -> &[SeenCorner] {
        &self.corners
    }
}
