//! Coloured balls in pictures: their outline to a fraction of a pixel, and the centre's covariance.
//!
//! Along rays from the ball's centre every pixel is unmixed into the ball's own colour B there and what lies behind, G: `I = s B + w G`.
//! The edge lies where the covered length ends, which blur, sharpening and the pixels' area leave in place; the nearest pixels count most. The ball's light changes up to
//! its rim; a sphere's shading is a smooth function of its normal, fitted to the ball's inside, and carried to the rim by it. Edges that do
//! not agree with a sphere's outline (another part hides it, a highlight, a neighbour) are left out.
//!
//! JPEG and most video keep colour at half of the brightness' resolution: there the brightness is brought to the colour's resolution, edges are read in
//! the codec's levels, weighted as a step with the codec's blur has it, and joined with those of the brightness at its own resolution, which is turned back to shares of light. Light mixes
//! in the lens, before the codec's curve: what that moves is integrated channel by channel.
//!
//! The outline of a sphere is a cone of rays: three numbers, which part of the arc is enough for.
//!
//! | file | what |
//! | --- | --- |
//! | `ball` | the whole measurement of one ball |
//! | `patch` | a cut-out of the picture, prepared: linear light, or levels at the colour's resolution; noise |
//! | `regions` | regions of the markers' colours, all in one pass |
//! | `codec` | which pixels share a colour, where the file does not say it |
//! | `circle`, `consensus` | a circle among points: the start; edges of one outline among others |
//! | `shading` | light on a sphere by its normal |
//! | `along` | light along a ray, of the ball and of what lies behind; in coded pictures by the brightness too |
//! | `hues`, `scatter` | in coded pictures: colours smoothed along the outline, and how far edges scatter round it |
//! | `rays`, `edges`, `luma`, `blur` | samples along rays, sub-pixel edges of the colour and of the brightness, and the blur that they show |
//! | `curve` | levels and light; what it moves that light mixes on another scale than the values are on: the codec's levels, a camera's own curve |
//! | `channels` | what the channels' edges say of the camera's curve |
//! | `unmixing` | a colour as a mixture of the ball's and of what lies behind |
//! | `cone` | the cone of rays that touch a sphere, with covariance |
//! | `whole`, `template` | a ball that is blurred over much of its radius, by all of its pixels; what it shows |
//! | `own_colour`, `common_blur` | its colour that its surroundings have not; the blur that balls share |

mod along;
mod ball;
mod blur;
mod channels;
mod circle;
mod codec;
mod common_blur;
mod cone;
mod consensus;
mod curve;
mod edges;
mod hues;
mod luma;
mod own_colour;
mod patch;
mod ray_edge;
mod rays;
mod regions;
mod scatter;
mod shading;
mod template;
mod unmixing;
mod whole;

pub use ball::{BallOutline, RadiusRange, measure_ball};
pub use circle::{Circle, fit_circle};
pub use codec::chroma_step;
pub use common_blur::CommonBlur;
pub use cone::{ConeFit, ConeOutline, EdgePoint, cone_centroid, fit_cone};
pub use patch::Picture;
pub use regions::{ColorBox, ColorRegion, color_regions};
pub use whole::{BlurredBall, ExpectedRadius, measure_blurred_ball};
