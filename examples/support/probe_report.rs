//! Results of a transmission probe as table, CSV and picture.

use std::error::Error;
use std::fmt::Write;
use std::path::Path;

use ecan_host::Distribution;
use ecan_tool_support::command_line::new_file;
use ecan_tool_support::plot::{Heading, HistogramFigure, HistogramRow, PlotError};

use crate::RunInfo;
use crate::bus_periods::BusPeriods;
use crate::tx_probe::ModeResult;

/// One row of the table: a measurement, and its frames on the bus if recorded.
#[derive(Debug)]
pub struct Row {
    pub result: ModeResult,
    pub bus: Option<BusPeriods>,
}

#[derive(Debug)]
pub struct Report {
    pub cycle: std::time::Duration,
    pub setting: String,
    pub run: RunInfo,
    pub banner: Option<String>,
    /// Source of the times on the bus, or the reason for their absence.
    pub bus_source: String,
    pub rows: Vec<Row>,
}

fn us(ns: u64) -> f64 {
    ns as f64 / 1e3
}

/// Head of the table, as in manual 13.9.
const HEAD: [&str; 7] = [
    "mode",
    "master period min/max (max error) us",
    "on the bus",
    "bus period min/max us",
    "p95 us",
    "p99 us",
    "order errors",
];

impl Report {
    fn cells(&self, row: &Row) -> [String; 7] {
        let period = row.result.statistics.period();
        let error = us(row.result.statistics.max_period_error_ns());
        let master = match period.count {
            0 => "none".to_owned(),
            _ => format!("{:.3}/{:.3} ({error:.3})", us(period.min_ns), us(period.max_ns)),
        };
        let sent = row.result.numbers.end - row.result.numbers.start;
        let mode = row.result.mode.to_string();
        let Some(bus) = &row.bus else {
            return [mode, master, format!("?/{sent}"), dash(), dash(), dash(), dash()];
        };
        let periods = Distribution::of(&bus.periods_ns);
        let of = |text: String| if periods.count == 0 { dash() } else { text };
        [
            mode,
            master,
            format!("{}/{sent}", bus.received()),
            of(format!("{:.1}/{:.1}", us(periods.min_ns), us(periods.max_ns))),
            of(format!("{:.1}", us(periods.p95_ns))),
            of(format!("{:.1}", us(periods.p99_ns))),
            bus.order_errors.to_string(),
        ]
    }

    /// The table of manual 13.9, for a terminal.
    pub fn table(&self) -> String {
        let rows: Vec<_> = self.rows.iter().map(|row| self.cells(row)).collect();
        let width = |column: usize| {
            let cells = rows.iter().map(|row| row[column].len());
            cells.max().unwrap_or(0).max(HEAD[column].len())
        };
        let mut table = String::new();
        let head = HEAD.map(str::to_owned);
        for row in std::iter::once(&head).chain(&rows) {
            for (column, cell) in row.iter().enumerate() {
                // Text is aligned left, numbers right.
                let width = width(column);
                let _ = match column {
                    0 => write!(table, "{cell:<width$}"),
                    _ => write!(table, "  {cell:>width$}"),
                };
            }
            table.push('\n');
        }
        let _ = writeln!(table, "{}", self.bus_source);
        table
    }

    /// Writes one line per frame: mode, number, start of its cycle, time and period on the bus, ns.
    pub fn write_csv(&self, path: &Path) -> Result<(), Box<dyn Error>> {
        let mut csv = String::from("mode,number,cycle_start_ns,bus_ns,bus_period_ns\n");
        for row in &self.rows {
            let mode = match row.result.mode {
                crate::tx_probe::Mode::Direct => "direct",
                crate::tx_probe::Mode::Scheduled { .. } => "scheduled",
            };
            let start = row.result.numbers.start;
            let mut on_bus = vec![None; row.result.sent_ns.len()];
            for (nth, frame) in row.bus.iter().flat_map(|bus| &bus.frames).enumerate() {
                let period =
                    row.bus.as_ref().and_then(|bus| bus.periods_ns.get(nth.checked_sub(1)?));
                let index = usize::try_from(frame.number - start)?;
                if let Some(entry) = on_bus.get_mut(index) {
                    *entry = Some((frame.time_ns, period.copied()));
                }
            }
            for (number, (sent_ns, bus)) in (start..).zip(row.result.sent_ns.iter().zip(on_bus)) {
                let text = |ns: Option<u64>| ns.map_or_else(String::new, |ns| ns.to_string());
                let (at, period) = (bus.map(|bus| bus.0), bus.and_then(|bus| bus.1));
                let _ = writeln!(csv, "{mode},{number},{sent_ns},{},{}", text(at), text(period));
            }
        }
        write(path, &csv)
    }

    /// Writes the picture, as a page with the table (`.html`) or alone (`.svg`).
    pub fn write_picture(&self, path: &Path) -> Result<(), Box<dyn Error>> {
        let is_svg = path.extension().is_some_and(|extension| extension == "svg");
        let text = match is_svg {
            true => self.figure(self.heading().with_run(self.run.clone())).to_svg()?,
            false => self.html()?,
        };
        write(path, &text)
    }

    fn html(&self) -> Result<String, PlotError> {
        let svg = self.figure(self.heading()).to_svg()?;
        let row = |cells: &[String; 7], tag: &str| -> String {
            let cell = |cell: &String| format!("<{tag}>{}</{tag}>", escaped(cell));
            format!("<tr>{}</tr>\n", cells.iter().map(cell).collect::<String>())
        };
        let head = row(&HEAD.map(str::to_owned), "th");
        let body: String = self.rows.iter().map(|values| row(&self.cells(values), "td")).collect();
        let notes: String =
            self.notes().iter().map(|note| format!("<p>{}</p>\n", escaped(note))).collect();
        let circumstances: String = self
            .run
            .rows()
            .iter()
            .map(|(name, value)| {
                format!("<tr><th>{name}</th><td class=\"fact\">{}</td></tr>\n", escaped(value))
            })
            .collect();
        let banner = self.banner.as_deref().map_or_else(String::new, |banner| {
            format!("<p><strong>{}</strong></p>\n", escaped(banner))
        });
        Ok(format!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <title>Direct and scheduled transmission</title>\n<style>\n\
             body {{ font-family: sans-serif; margin: 2em; color: #222; max-width: 66em; }}\n\
             table {{ border-collapse: collapse; margin: 1em 0; }}\n\
             th, td {{ border: 1px solid #ccc; padding: 0.35em 0.8em; text-align: right; \
             white-space: nowrap; }}\n\
             th {{ background: #f3f3f3; white-space: normal; }}\n\
             th:first-child, td:first-child, td.fact {{ text-align: left; white-space: normal; }}\n\
             svg {{ max-width: 100%; height: auto; }}\n</style>\n</head>\n<body>\n\
             <h1>Direct and scheduled transmission</h1>\n{banner}<p>{}</p>\n<table>\n{head}{body}</table>\n\
             {notes}{svg}<h2>Circumstances</h2>\n<table>\n{circumstances}</table>\n</body>\n</html>\n",
            escaped(&self.setting)
        ))
    }

    pub fn notes(&self) -> Vec<String> {
        let mut notes = vec![self.bus_source.clone()];
        for Row { result, .. } in &self.rows {
            if result.rejected > 0 {
                notes.push(format!(
                    "{}: {} temporary rejections; the frame was sent in a later cycle",
                    result.mode, result.rejected
                ));
            }
            let account = &result.account;
            if account.scheduled > 0 {
                notes.push(format!(
                    "{}: results of {} frames: {} sent, {} rejected by a full queue, {} not sent for another \
                     reason, {} unknown; {} withdrawn by the host",
                    result.mode,
                    account.scheduled,
                    account.sent,
                    account.queue_full,
                    account.not_sent,
                    account.unknown + account.open,
                    account.withdrawn
                ));
            }
            if let Some(fault) = result.schedule_fault {
                notes.push(format!("{}: {fault}", result.mode));
            }
            if result.incomplete_cycles > 0 {
                notes.push(format!(
                    "{}: {} cycles with an incomplete working counter",
                    result.mode, result.incomplete_cycles
                ));
            }
        }
        notes
    }

    /// Histograms of each measurement on the bus, then of each of the master.
    fn figure(&self, heading: Heading) -> HistogramFigure {
        let bus = |row: &Row| row.bus.as_ref().map_or_else(Vec::new, |bus| bus.periods_ns.clone());
        let master = |row: &Row| row.result.master_periods_ns.clone();
        let kinds: [(&str, Vec<Vec<u64>>); 2] = [
            ("period on the bus", self.rows.iter().map(bus).collect()),
            ("master period", self.rows.iter().map(master).collect()),
        ];
        let mut rows = Vec::new();
        for (kind, measurements) in kinds {
            for (measurement, (row, times_ns)) in self.rows.iter().zip(measurements).enumerate() {
                let periods = Distribution::of(&times_ns);
                let (min, max) = (us(periods.min_ns), us(periods.max_ns));
                let p99 = us(periods.p99_ns);
                rows.push(HistogramRow {
                    title: row.result.mode.to_string(),
                    figures: format!("min/max {min:.1}/{max:.1} us, p99 {p99:.1} us"),
                    kind: kind.to_owned(),
                    measurement,
                    times_ns,
                });
            }
        }
        let nominal_us = self.cycle.as_secs_f64() * 1e6;
        HistogramFigure { heading, nominal_us, x_label: "period [us]".to_owned(), rows }
    }

    fn heading(&self) -> Heading {
        Heading::new("Direct and scheduled transmission")
            .with_subtitle(self.setting.clone())
            .simulated(self.banner.is_some())
    }
}

/// Escapes the characters that HTML reserves.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

fn dash() -> String {
    "-".to_owned()
}

fn write(path: &Path, text: &str) -> Result<(), Box<dyn Error>> {
    let written = new_file::write(path, text);
    Ok(written.map_err(|source| PlotError::Write { path: path.to_owned(), source })?)
}
