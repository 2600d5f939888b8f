//! Connected regions of the markers' colours: all colours in one pass over the picture.
//!
//! Hue, saturation and value as OpenCV has them (hue in degrees, the others 0..1). A row's pixels of a colour are joined to runs, runs of neighbouring rows to
//! regions (8 neighbours) by union and find (Rosenfeld and Pfaltz, "Sequential operations in digital picture processing", 1966).

use super::patch::Picture;
use multiversion::multiversion;
use nalgebra::Vector2;

/// So many pixels are looked at together.
const TOGETHER: usize = 32;
/// Shares of a value in whole numbers.
const SHARES: f32 = 256.0;

/// A colour as a box in hue (circular, degrees), saturation and value (0..1).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ColorBox {
    /// Degrees.
    pub hue_deg: f32,
    /// On both sides, degrees.
    pub hue_tolerance_deg: f32,
    /// 0..1.
    pub min_saturation: f32,
    /// 0..1.
    pub min_value: f32,
}

impl ColorBox {
    fn holds(&self, hue_deg: f32, saturation: f32, value: f32) -> bool {
        let away = (hue_deg - self.hue_deg).abs() % 360.0;
        saturation >= self.min_saturation
            && value >= self.min_value
            && away.min(360.0 - away) <= self.hue_tolerance_deg
    }
}

/// A connected region of one colour.
#[derive(Debug, Clone, PartialEq)]
pub struct ColorRegion {
    /// Pixels.
    pub area_px: usize,
    /// Their mean, px.
    pub centroid_px: Vector2<f64>,
    /// Left, top, width, height, px.
    pub box_px: [usize; 4],
    /// Which pixels of the box belong to it, row by row.
    pub mask: Vec<bool>,
}

/// Pixels of one row from `start` to before `end`.
#[derive(Clone, Copy)]
struct Run {
    row: u32,
    start: u32,
    end: u32,
}

/// The runs of one colour, joined as the rows come.
#[derive(Default)]
struct Joined {
    runs: Vec<Run>,
    parent: Vec<u32>,
    previous: usize,
    current: usize,
}

impl Joined {
    fn add(&mut self, row: u32, column: u32) {
        if self.runs.len() > self.current
            && let Some(last) = self.runs.last_mut()
            && last.end == column
        {
            last.end += 1;
            return;
        }
        self.parent.push(self.runs.len() as u32);
        self.runs.push(Run { row, start: column, end: column + 1 });
    }

    fn root(&mut self, mut at: u32) -> u32 {
        while self.parent[at as usize] != at {
            let above = self.parent[self.parent[at as usize] as usize];
            self.parent[at as usize] = above;
            at = above;
        }
        at
    }

    /// Joins the row's runs with those of the row before that they touch, corners included.
    fn end_row(&mut self) {
        let mut above = self.previous;
        for here in self.current..self.runs.len() {
            let Run { start, end, .. } = self.runs[here];
            while above < self.current && self.runs[above].end < start {
                above += 1;
            }
            let mut other = above;
            while other < self.current && self.runs[other].start <= end {
                let (a, b) = (self.root(here as u32), self.root(other as u32));
                // The first run of a region represents it.
                self.parent[a.max(b) as usize] = a.min(b);
                other += 1;
            }
        }
        self.previous = self.current;
        self.current = self.runs.len();
    }

    /// A row without the colour between two with it parts them.
    fn regions(mut self, least_area_px: usize, most: usize) -> Vec<ColorRegion> {
        let count = self.runs.len();
        let mut index_of_root = vec![usize::MAX; count];
        let mut members: Vec<Vec<usize>> = Vec::new();
        let mut areas: Vec<usize> = Vec::new();
        for i in 0..count {
            let root = self.root(i as u32) as usize;
            if index_of_root[root] == usize::MAX {
                index_of_root[root] = members.len();
                members.push(Vec::new());
                areas.push(0);
            }
            members[index_of_root[root]].push(i);
            areas[index_of_root[root]] += (self.runs[i].end - self.runs[i].start) as usize;
        }
        let mut order: Vec<usize> = (0..members.len()).filter(|i| areas[*i] >= least_area_px).collect();
        order.sort_by_key(|i| core::cmp::Reverse(areas[*i]));
        order.truncate(most);
        order.into_iter().map(|i| region_of(&self.runs, &members[i], areas[i])).collect()
    }
}

fn region_of(runs: &[Run], members: &[usize], area_px: usize) -> ColorRegion {
    let mine = || members.iter().map(|i| &runs[*i]);
    let left = mine().map(|r| r.start).min().unwrap_or(0) as usize;
    let right = mine().map(|r| r.end).max().unwrap_or(0) as usize;
    let top = mine().map(|r| r.row).min().unwrap_or(0) as usize;
    let bottom = mine().map(|r| r.row + 1).max().unwrap_or(0) as usize;
    let (width, height) = (right - left, bottom - top);
    let mut mask = vec![false; width * height];
    let mut sum = Vector2::zeros();
    for run in mine() {
        let row = run.row as usize - top;
        mask[row * width + run.start as usize - left..row * width + run.end as usize - left].fill(true);
        let length = f64::from(run.end - run.start);
        sum += Vector2::new(0.5 * f64::from(run.start + run.end - 1), f64::from(run.row)) * length;
    }
    ColorRegion { area_px, centroid_px: sum / area_px as f64, box_px: [left, top, width, height], mask }
}

/// The connected regions (8 neighbours) of each colour with at least `least_area_px` pixels, the largest first, at most so many.
pub fn color_regions(
    picture: &Picture<'_>,
    colors: &[ColorBox],
    least_area_px: usize,
    most: usize,
) -> Vec<Vec<ColorRegion>> {
    let mut joined: Vec<Joined> = colors.iter().map(|_| Joined::default()).collect();
    let least = |of: fn(&ColorBox) -> f32| colors.iter().map(of).fold(f32::INFINITY, f32::min);
    let (pale, dark) = (least(|c| c.min_saturation), least(|c| c.min_value));
    // Most of a picture is too pale or too dark for every colour, which whole numbers alone decide.
    let needed: [u8; 256] = core::array::from_fn(|value| {
        if (value as f32) < dark * 255.0 - 0.5 {
            255
        } else {
            (pale * value as f32 - 1e-3).ceil().clamp(0.0, 255.0) as u8
        }
    });
    // The same of many at once, where a table takes longer than what it saves: a spread that none of them has.
    let (dimmest, shares) = (needed.iter().position(|least| *least < 255).unwrap_or(255), pale * SHARES);
    let by_value = shares.floor().clamp(0.0, SHARES) as u16;
    for row in 0..picture.height {
        for (block, pixels) in picture.row(row).chunks(3 * TOGETHER).enumerate() {
            if !any_coloured(pixels, dimmest as u8, by_value) {
                continue;
            }
            for (at, pixel) in pixels.chunks_exact(3).enumerate() {
                let (blue, green, red) = (pixel[0], pixel[1], pixel[2]);
                let high = blue.max(green).max(red);
                let spread = high - blue.min(green).min(red);
                if spread < needed[usize::from(high)] {
                    continue;
                }
                let (hue, saturation) = hue_and_saturation(blue, green, red, high, spread);
                let value = f32::from(high) / 255.0;
                for (one, joined) in colors.iter().zip(&mut joined) {
                    if one.holds(hue, saturation, value) {
                        joined.add(row as u32, (block * TOGETHER + at) as u32);
                    }
                }
            }
        }
        joined.iter_mut().for_each(Joined::end_row);
    }
    joined.into_iter().map(|one| one.regions(least_area_px, most)).collect()
}

/// Whether a pixel of a row's part may have a colour: one at least as bright, and its spread so many 256ths of its value, less what rounding takes.
#[multiversion(targets("x86_64+avx512f", "x86_64+avx2"))]
fn any_coloured(pixels: &[u8], dimmest: u8, by_value: u16) -> bool {
    let mut found = 0u8;
    for pixel in pixels.chunks_exact(3) {
        let (blue, green, red) = (pixel[0], pixel[1], pixel[2]);
        let high = blue.max(green).max(red);
        let spread = high - blue.min(green).min(red);
        let least = ((by_value * u16::from(high)) >> 8) as u8;
        found |= u8::from(high >= dimmest) & u8::from(spread >= least);
    }
    found > 0
}

fn hue_and_saturation(blue: u8, green: u8, red: u8, high: u8, spread: u8) -> (f32, f32) {
    if spread == 0 {
        return (0.0, 0.0);
    }
    let [b, g, r] = [blue, green, red].map(f32::from);
    let turn = 60.0 / f32::from(spread);
    let hue = if high == red {
        (g - b) * turn
    } else if high == green {
        120.0 + (b - r) * turn
    } else {
        240.0 + (r - g) * turn
    };
    (if hue < 0.0 { hue + 360.0 } else { hue }, f32::from(spread) / f32::from(high))
}
