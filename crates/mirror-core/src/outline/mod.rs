//! Coloured balls in pictures: their outline to a fraction of a pixel, and the centre's covariance.
//!
//! Along rays from the ball's centre every pixel is unmixed into the ball's own colour B there and the background G:
//! `I = s B + w G`. The edge is where the covered length ends; blur, sharpening and the pixels' area do not move it.
//! The nearest pixels have the largest weight. The ball's light changes up to its rim: a sphere's shading is a
//! smooth function of its normal, which is fitted to the ball's inside and extrapolated to the rim. Edges that do
//! not agree with a sphere's outline (occlusion, a highlight, a neighbour) are left out.
//!
//! JPEG and most video store colour at half of the brightness' resolution. There the brightness is reduced to the
//! colour's resolution, edges are read in the codec's levels and weighted as a step with the codec's blur, and
//! combined with the edges of the brightness at full resolution, which is converted back to shares of light. Light
//! mixes in the lens, before the codec's curve; the displacement by that is integrated channel by channel.
//!
//! The outline of a sphere is a cone of rays with three parameters, so part of the arc is sufficient.
//!
//! | file | what |
//! | --- | --- |
//! | `ball` | the whole measurement of one ball |
//! | `patch` | a cut-out of the picture, prepared: linear light, or levels at the colour's resolution |
//! | `picture_noise` | how much noise a picture has, how far it is correlated, how much it is smoothed |
//! | `regions` | regions of the markers' colours, all in one pass |
//! | `codec` | which pixels share a colour, where the file does not say it |
//! | `codec_error`, `surroundings`, `recoding` | what a coarse JPEG's rounding does to a centre; surroundings coded once more on a moved grid |
//! | `circle`, `consensus` | a circle among points, as the start; the edges of one outline among others |
//! | `shading`, `columns` | light on a sphere by its normal; its pixels by column |
//! | `along` | light along a ray, of the ball and of the background; in coded pictures by the brightness too |
//! | `glints` | in coded pictures: light that a glossy ball mirrors |
//! | `hues`, `scatter` | in coded pictures: colours smoothed along the outline; the scatter of edges around it |
//! | `sight`, `rays`, `edges`, `luma`, `blur` | where rays are sampled, the light along them, sub-pixel edges of the colour and of the brightness, and the blur that they show |
//! | `curve` | levels and light; displacement where light mixes on another scale than the values are on: the codec's levels, a camera's tone curve |
//! | `channels`, `pattern_curve` | the camera's tone curve from the channels' edges, and from the board's pattern |
//! | `unmixing` | a colour as a mixture of the ball's and the background's |
//! | `drawn`, `ghost_light` | the board's pattern as a picture shows it without a lens; light without a pane's ghost |
//! | `cone`, `shared` | the cone of rays that touch a sphere, with covariance; errors that its edges share |
//! | `whole`, `template` | a ball that is blurred over much of its radius, fitted to all of its pixels; its image |
//! | `ghost`, `pattern_rows` | the second picture that a pane shows, told by the board's pattern; rows of numbers by pixel |
//! | `own_colour`, `common_blur` | the part of its colour that the surroundings lack; the blur that balls share |

mod along;
mod ball;
mod blur;
mod channels;
mod circle;
mod codec;
mod codec_error;
mod columns;
mod common_blur;
mod cone;
mod consensus;
mod curve;
mod drawn;
mod edges;
mod ghost;
mod ghost_light;
mod glints;
mod hues;
mod luma;
mod own_colour;
mod patch;
mod pattern_curve;
mod pattern_rows;
mod picture_noise;
mod ray_edge;
mod rays;
mod recoding;
mod regions;
mod scatter;
mod shading;
mod shared;
mod sight;
mod surroundings;
mod template;
mod unmixing;
mod whole;

pub use ball::{BallOutline, RadiusRange, measure_ball};
pub use circle::{Circle, fit_circle};
pub use codec::chroma_step;
pub use codec_error::codec_covariance;
pub use common_blur::CommonBlur;
pub use cone::{ConeFit, ConeOutline, EdgePoint, cone_centroid, fit_cone};
pub use drawn::drawn_pattern;
pub use ghost::{PatternGhost, PatternView, pattern_ghost};
pub use ghost_light::without_ghost;
pub use patch::Picture;
pub use pattern_curve::{PatternCurve, PatternLevels, pattern_curve};
pub use recoding::Codec;
pub use regions::{ColorBox, ColorRegion, color_regions};
pub use whole::{BlurredBall, ExpectedRadius, measure_blurred_ball};
