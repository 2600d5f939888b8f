//! A ball's surroundings in a picture, coded once more on several grids of blocks.

use super::patch::{Picture, Place};
use super::recoding::{Codec, Planes};
use nalgebra::Vector2;

/// A ball's surroundings, to be coded again on several grids.
pub(super) struct Surroundings<'a> {
    codec: &'a Codec,
    place: Place,
    levels: Vec<[u8; 3]>,
    planes: Planes,
    /// The planes' first pixel.
    first: [isize; 2],
    middle_px: Vector2<f64>,
    reach_px: f64,
}

impl<'a> Surroundings<'a> {
    /// At a place of a picture that begins at whole samples of colour; units that reach into a circle are coded.
    pub fn of(
        codec: &'a Codec,
        picture: &Picture<'_>,
        place: &Place,
        middle_px: &Vector2<f64>,
        reach_px: f64,
    ) -> Self {
        // Grids may begin by a unit before the place, and end by one beyond.
        let [across, down] = codec.unit();
        let first = [place.left as isize - across as isize, place.top as isize - down as isize];
        let size = (
            place.width.next_multiple_of(across) + 2 * across,
            place.height.next_multiple_of(down) + 2 * down,
        );
        Self {
            codec,
            place: *place,
            levels: place.levels(picture),
            planes: Planes::of(picture, (first[0], first[1]), size, codec.sampling()),
            first,
            middle_px: *middle_px,
            reach_px,
        }
    }

    /// The levels, coded again; `moved` px, whole samples of colour, is where the picture's grid of blocks begins.
    pub fn again(&self, moved: (usize, usize)) -> Vec<[u8; 3]> {
        let [across, down] = self.codec.unit();
        let Place { left, top, width, height } = self.place;
        // The first unit that reaches into the place, in the planes' pixels.
        let begin = |low: usize, unit: usize, moved: usize, first: isize| {
            let unit = unit as isize;
            ((low as isize - moved as isize).div_euclid(unit) * unit + moved as isize - first) as usize
        };
        let first_x = begin(left, across, moved.0, self.first[0]);
        let first_y = begin(top, down, moved.1, self.first[1]);
        let mut planes = self.planes.clone();
        let mut coded = Vec::new();
        for y in (first_y..down + height).step_by(down) {
            for x in (first_x..across + width).step_by(across) {
                if self.reaches([x, y]) {
                    coded.push([x, y]);
                }
            }
        }
        self.codec.code_units(&mut planes, &coded);
        let mut levels = self.levels.clone();
        for [x, y] in coded {
            let decoded = planes.decoded([x, y], self.codec.sampling());
            let (begin, end) = (x.max(across), (x + across).min(across + width));
            for row in y.max(down)..(y + down).min(down + height) {
                let to = (row - down) * width;
                levels[to + begin - across..to + end - across]
                    .copy_from_slice(&decoded[row - y][begin - x..end - x]);
            }
        }
        levels
    }

    /// Whether the unit from a pixel of the planes on lies in the circle, or touches it.
    fn reaches(&self, [x, y]: [usize; 2]) -> bool {
        let away = |low: isize, size: usize, middle: f64| {
            let low = low as f64;
            (low - middle).max(middle - (low + size as f64)).max(0.0)
        };
        let [across, down] = self.codec.unit();
        let (u, v) = (x as isize + self.first[0], y as isize + self.first[1]);
        away(u, across, self.middle_px.x).hypot(away(v, down, self.middle_px.y)) < self.reach_px
    }
}
