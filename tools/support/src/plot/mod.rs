//! Pictures of measurements, as SVG: values over time, axes, histograms, usable Sync0 shifts.
//!
//! Every picture has a title, the circumstances of the run, axes with units, a grid and a legend. A
//! simulated run is marked `SIMULATED`.

mod axis_recorder;
mod axis_trace;
mod canvas;
mod heading;
mod histogram;
mod histogram_figure;
mod label_rows;
mod plot_error;
mod scale;
mod shift_figure;
mod time_figure;
mod time_panel;

pub use axis_recorder::AxisRecorder;
pub use axis_trace::{AxisEvent, AxisSample, AxisTrace};
pub use heading::Heading;
pub use histogram::{Histogram, HistogramRange};
pub use histogram_figure::{HistogramFigure, HistogramRow};
pub use plot_error::PlotError;
pub use shift_figure::{ShiftFigure, ShiftRow};
pub use time_figure::TimeFigure;
pub use time_panel::{Band, Mark, Series, TimePanel, Tone};
