//! Pictures of measurements, as SVG: curves, motion of axes, histograms, usable Sync0 shifts.
//!
//! Every picture has a title, a description, the circumstances of the run, axes with units, a grid and a
//! legend. A simulated run is marked `SIMULATED`. Axes begin at 0 or are marked. Texts and legends are
//! outside the diagrams.

mod axis_trace;
mod canvas;
mod curve_figure;
mod histogram;
mod panel_head;
mod shift_figure;

pub use axis_trace::{AxisEvent, AxisRecorder, AxisSample, AxisTrace};
pub use canvas::{AxisKind, Heading, PlotError, check_file};
pub use curve_figure::{Band, BandKind, CurveFigure, CurvePanel, CurveStack, Mark, Series, Tone};
pub use histogram::{Histogram, HistogramFigure, HistogramRange, HistogramRow};
pub use shift_figure::{ShiftFigure, ShiftRow};
