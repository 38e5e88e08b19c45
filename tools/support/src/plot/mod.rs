//! Pictures of measurements, as SVG: values over time, axes, histograms, usable Sync0 shifts.
//!
//! Every picture has a title, the circumstances of the run, axes with units, a grid and a legend. A
//! simulated run is marked `SIMULATED`.

mod axis_trace;
mod canvas;
mod histogram;
mod shift_figure;
mod time_figure;

pub use axis_trace::{AxisEvent, AxisRecorder, AxisSample, AxisTrace};
pub use canvas::{Heading, PlotError};
pub use histogram::{Histogram, HistogramFigure, HistogramRange, HistogramRow};
pub use shift_figure::{ShiftFigure, ShiftRow};
pub use time_figure::{Band, Mark, Series, TimeFigure, TimePanel, Tone};
