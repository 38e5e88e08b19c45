//! Pictures as a reader of SVG sees them.

use ecan_cia402::{AxisPhase, HoldReason};
use ecan_tool_support::command_line::run_info::RunInfo;
use ecan_tool_support::plot::{
    AxisEvent, AxisSample, AxisTrace, Heading, HistogramFigure, HistogramRow, Mark, PlotError,
    Series, ShiftFigure, ShiftRow, TimeFigure, TimePanel, Tone,
};

/// Texts of a picture, in the order of drawing.
fn texts(svg: &str) -> Vec<String> {
    let document = roxmltree::Document::parse(svg).unwrap();
    let texts = document.descendants().filter(|node| node.has_tag_name("text"));
    texts.filter_map(|node| Some(node.text()?.trim().to_owned())).collect()
}

fn elements(svg: &str, tag: &str, attribute: (&str, &str)) -> usize {
    let document = roxmltree::Document::parse(svg).unwrap();
    let is_it = |node: &roxmltree::Node<'_, '_>| {
        node.has_tag_name(tag) && node.attribute(attribute.0) == Some(attribute.1)
    };
    document.descendants().filter(is_it).count()
}

fn contains(texts: &[String], expected: &str) -> bool {
    texts.iter().any(|text| text == expected)
}

const LIGHT_BLUE: (&str, &str) = ("stroke", "#86BCE6");
const ORANGE: (&str, &str) = ("stroke", "#D9542B");

/// Ten seconds of motion with a hold from 4 s to 6 s.
fn trace() -> AxisTrace {
    let mut trace = AxisTrace::new(101);
    for nth in 0..=100 {
        let (seconds, position) = (f64::from(nth) / 10.0, nth * 1_000);
        let is_holding = (4.0..6.0).contains(&seconds);
        let target = (!is_holding).then_some(position + 250);
        let following_error = target.map(|target| i64::from(target - position));
        let actual = Some(position);
        trace.record(AxisSample { seconds, target, actual, following_error }, true);
    }
    let hold = AxisPhase::Holding(HoldReason::BusOff);
    trace.record_event(4.0, AxisEvent::Phase(hold));
    trace.record_event(6.0, AxisEvent::Phase(AxisPhase::Running));
    trace
}

fn figure(heading: Heading) -> TimeFigure {
    let [positions, error] = trace().panels("axis 0: node 1 (slave 0, channel 0)");
    let panels = vec![(positions, 260), (error, 190)];
    TimeFigure { heading, x_label: "time [s]".into(), panels }
}

#[test]
fn axis_picture_has_units_legend_and_hold() {
    let run = RunInfo::of_this_run("demo", "1.2.3");
    let heading = Heading::new("Positions").with_subtitle("cycle 1000 us").with_run(run);
    let svg = figure(heading).to_svg().unwrap();
    let texts = texts(&svg);
    for expected in [
        "Positions",
        "cycle 1000 us",
        "axis 0: node 1 (slave 0, channel 0)",
        "position [inc]",
        "following error: largest 250 inc",
        "error [inc]",
        "time [s]",
        "target",
        "actual position",
        "target - actual position",
        "holding: the channel went bus-off",
        "following targets",
        "100000",
    ] {
        assert!(contains(&texts, expected), "{expected}: {texts:?}");
    }
    assert!(texts.iter().any(|text| text.contains("demo 1.2.3, Linux ")), "{texts:?}");
    assert!(!contains(&texts, "SIMULATED"), "{texts:?}");
    // The target is interrupted by the hold; one more line each is in the legend.
    assert_eq!(elements(&svg, "polyline", LIGHT_BLUE), 3);
    assert_eq!(elements(&svg, "polyline", ORANGE), 2);
    let bands = elements(&svg, "rect", ("fill", "#F6C35B"));
    assert_eq!(bands, 2, "the hold is in both panels");
}

#[test]
fn simulated_run_is_marked_in_every_kind_of_picture() {
    let heading = || Heading::new("A & B < C").simulated(true);
    let row = HistogramRow {
        title: "direct".into(),
        figures: "p99 1001 us".into(),
        kind: "period".into(),
        measurement: 0,
        times_ns: vec![1_000_000, 1_000_500, 1_001_000],
    };
    let x_label = "period [us]".into();
    let rows = vec![row];
    let histogram = HistogramFigure { heading: heading(), nominal_us: 1_000.0, x_label, rows };
    let shifts = ShiftFigure { heading: heading(), rows: vec![shifts()] };
    for svg in [figure(heading()).to_svg(), histogram.to_svg(), shifts.to_svg()] {
        let texts = texts(&svg.unwrap());
        assert!(contains(&texts, "SIMULATED") && contains(&texts, "A & B < C"), "{texts:?}");
    }
}

fn shifts() -> ShiftRow {
    ShiftRow {
        title: "1 ms, 384B".into(),
        period_ns: 1_000_000,
        shifts: (0..10).map(|nth| (nth * 100_000, nth != 3 && nth != 4)).collect(),
        recommended_ns: Some(700_000),
        planned_ns: Some((550_000, 230_000)),
    }
}

#[test]
fn shift_picture_has_a_bar_for_each_shift() {
    let svg = ShiftFigure { heading: Heading::new("Shifts"), rows: vec![shifts()] }.to_svg();
    let svg = svg.unwrap();
    let bars = |color| elements(&svg, "rect", ("fill", color));
    // One more of each in the legend; the range of the plan continues after the end of the period.
    assert_eq!((bars("#2E8B3A"), bars("#C02B2B"), bars("#0B62A4")), (9, 3, 3));
    let texts = texts(&svg);
    assert!(contains(&texts, "1 ms, 384B") && contains(&texts, "Sync0 shift [us]"), "{texts:?}");
}

#[test]
fn histogram_shows_single_times_and_common_axes() {
    let row = |measurement, times_ns: Vec<u64>| HistogramRow {
        title: format!("mode {measurement}"),
        figures: "figures".into(),
        kind: "period on the bus".into(),
        measurement,
        times_ns,
    };
    let mut times: Vec<u64> = vec![1_000_000; 999];
    times.push(1_900_000);
    let rows = vec![row(0, times), row(1, vec![1_000_000; 1_000]), row(2, Vec::new())];
    let x_label = "period [us]".into();
    let heading = Heading::new("Periods");
    let svg = HistogramFigure { heading, nominal_us: 1_000.0, x_label, rows }.to_svg().unwrap();
    let bars = |color| elements(&svg, "rect", ("fill", color));
    assert_eq!((bars("#D9542B"), bars("#0B62A4")), (4, 2), "two bars and one, on both axes");
    let texts = texts(&svg);
    assert!(contains(&texts, "mode 0: period on the bus, common axes"), "{texts:?}");
    assert!(!texts.iter().any(|text| text.starts_with("mode 2")), "no times: {texts:?}");
    assert_eq!(texts.iter().filter(|text| *text == "nominal 1000 us").count(), 4);
}

#[test]
fn picture_without_samples_is_valid() {
    let panel = TimePanel {
        series: vec![Series { name: "value".into(), tone: Tone::Actual, points: Vec::new() }],
        marks: vec![Mark { seconds: 0.5, text: String::new() }],
        mark_name: "reading missed".into(),
        ..TimePanel::default()
    };
    let figure = TimeFigure { panels: vec![(panel, 200)], ..TimeFigure::default() };
    assert!(contains(&texts(&figure.to_svg().unwrap()), "reading missed (1)"));
    assert!(texts(&TimeFigure::default().to_svg().unwrap()).iter().all(String::is_empty));
    let svg = HistogramFigure::default().to_svg().unwrap();
    assert!(!svg.contains("NaN"), "{svg}");
}

#[test]
fn file_that_cannot_be_written_is_named() {
    let figure = TimeFigure::default();
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("picture.svg");
    figure.write(&path).unwrap();
    assert!(std::fs::read_to_string(path).unwrap().ends_with("</svg>\n"));
    let error = figure.write(&directory.path().join("none/picture.svg")).unwrap_err();
    assert!(matches!(error, PlotError::Write { .. }));
    assert!(error.to_string().contains("none/picture.svg"), "{error}");
}
