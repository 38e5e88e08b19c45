//! Pictures as a reader of SVG sees them.

use ecan_cia402::{AxisPhase, HoldReason};
use ecan_tool_support::command_line::run_info::RunInfo;
use ecan_tool_support::plot::{
    AxisEvent, AxisKind, AxisSample, AxisTrace, CurveFigure, CurvePanel, CurveStack, Heading,
    HistogramFigure, HistogramRow, Mark, PlotError, Series, ShiftFigure, ShiftRow, Tone,
};

/// Texts of a picture, in the order of drawing.
fn texts(svg: &str) -> Vec<String> {
    let document = roxmltree::Document::parse(svg).unwrap();
    let texts = document.descendants().filter(|node| node.has_tag_name("text"));
    texts.filter_map(|node| Some(node.text()?.trim().to_owned())).collect()
}

fn elements(svg: &str, tag: &str, attribute: (&str, &str)) -> usize {
    let document = roxmltree::Document::parse(svg).unwrap();
    let is_element = |node: &roxmltree::Node<'_, '_>| {
        node.has_tag_name(tag) && node.attribute(attribute.0) == Some(attribute.1)
    };
    document.descendants().filter(is_element).count()
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

fn stack(x_label: &str, x_kind: AxisKind, panels: Vec<(CurvePanel, u32)>) -> CurveStack {
    CurveStack { x_label: x_label.into(), x_kind, panels }
}

fn figure(heading: Heading) -> CurveFigure {
    let [positions, error] = trace().panels("axis 0: node 1 (slave 0, channel 0)");
    let panels = vec![(positions, 260), (error, 190)];
    CurveFigure { heading, stacks: vec![stack("time [s]", AxisKind::Linear, panels)] }
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
        "4.00 s: holding: the channel went bus-off",
        "6.00 s: following targets",
        "holding",
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
    assert_eq!(bands, 4, "the hold is in both panels and in their legends");
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
    assert_eq!(
        (bars("#D9542B"), bars("#0B62A4")),
        (6, 4),
        "two bars and one, on both axes with legends"
    );
    let texts = texts(&svg);
    assert!(contains(&texts, "mode 0: period on the bus, common axes"), "{texts:?}");
    assert!(!texts.iter().any(|text| text.starts_with("mode 2")), "no times: {texts:?}");
    assert_eq!(texts.iter().filter(|text| *text == "nominal 1000 us").count(), 4);
}

/// Title and description for readers who cannot see the picture.
#[test]
fn every_kind_of_picture_has_a_title_and_a_description() {
    let row = HistogramRow {
        title: "direct".into(),
        figures: "p99 1001 us".into(),
        kind: "period".into(),
        measurement: 0,
        times_ns: vec![1_000_000, 1_001_000],
    };
    let heading = || Heading::new("A & B < C").with_subtitle("cycle 1 ms").simulated(true);
    let histogram = HistogramFigure {
        heading: heading(),
        nominal_us: 1_000.0,
        x_label: "period [us]".into(),
        rows: vec![row],
    };
    let shifts = ShiftFigure { heading: heading(), rows: vec![shifts()] };
    let pictures = [
        (
            figure(heading()).to_svg(),
            "position [inc] from 0 to 106265: target, actual position, 4.00 s: holding",
        ),
        (histogram.to_svg(), "direct, period: p99 1001 us, 2 cycles"),
        (shifts.to_svg(), "1 ms, 384B: 10 shifts tested, usable [us]: 0, 100, 200, 500"),
    ];
    for (svg, part) in pictures {
        let svg = svg.unwrap();
        let document = roxmltree::Document::parse(&svg).unwrap();
        let root = document.root_element();
        assert_eq!(root.attribute("role"), Some("img"));
        let children: Vec<_> =
            root.children().filter(roxmltree::Node::is_element).take(2).collect();
        assert!(children[0].has_tag_name("title") && children[1].has_tag_name("desc"));
        assert_eq!(children[0].text(), Some("A & B < C"));
        let description = children[1].text().unwrap();
        assert!(description.starts_with("Simulated run. cycle 1 ms. "), "{description}");
        assert!(description.contains(part), "{description}");
    }
}

/// Vertical positions of the texts with this start, and the upper edge of the first diagram.
fn heights(svg: &str, start: &str) -> (Vec<f64>, f64) {
    let document = roxmltree::Document::parse(svg).unwrap();
    let number = |node: &roxmltree::Node<'_, '_>, name| node.attribute(name)?.parse::<f64>().ok();
    let texts = document.descendants().filter(|node| node.has_tag_name("text"));
    let found = texts.filter(|node| node.text().is_some_and(|text| text.trim().starts_with(start)));
    let bands = document.descendants().filter(|node| node.attribute("fill") == Some("#F6C35B"));
    // The bands are as high as their diagrams; those of the legends are low.
    let high = bands.filter(|node| number(node, "height").is_some_and(|height| height > 400.0));
    let top = high.filter_map(|node| number(&node, "y")).fold(f64::INFINITY, f64::min);
    (found.filter_map(|node| number(&node, "y")).collect(), top)
}

#[test]
fn texts_of_events_are_above_the_diagram() {
    let svg = figure(Heading::new("Positions")).to_svg().unwrap();
    for text in ["4.00 s: holding: the channel went bus-off", "6.00 s: following targets"] {
        let (found, top) = heights(&svg, text);
        assert!(found.len() == 1 && found[0] < top, "{text}: {found:?} {top}");
    }
    let (numbers, top) = heights(&svg, "2");
    assert!(numbers.iter().any(|y| (top - 120.0..top).contains(y)), "{numbers:?} {top}");
}

#[test]
fn fault_after_the_last_sample_is_inside_the_diagram() {
    let mut trace = trace();
    trace.record_event(12.0, AxisEvent::Phase(AxisPhase::Fault));
    let panels = trace.panels("axis 0").map(|panel| (panel, 200)).into();
    let stacks = vec![stack("time [s]", AxisKind::Linear, panels)];
    let svg = CurveFigure { stacks, ..CurveFigure::default() }.to_svg().unwrap();
    assert!(contains(&texts(&svg), "12.00 s: fault") && contains(&texts(&svg), "12"));
    assert_eq!(elements(&svg, "rect", ("fill", "#C02B2B")), 4, "two bands, two legends");
}

#[test]
fn clipped_curve_and_axis_without_0_are_marked() {
    let points = (0..100).map(|nth| (f64::from(nth), Some(f64::from(nth % 50)))).collect();
    let series = vec![Series { name: "value".into(), tone: Tone::Difference, points }];
    let panel = CurvePanel { y: Some(20.0..30.0), series, ..CurvePanel::default() };
    let stacks = vec![stack("n", AxisKind::Count, vec![(panel, 200)])];
    let svg = CurveFigure { stacks, ..CurveFigure::default() }.to_svg().unwrap();
    let texts = texts(&svg);
    assert!(contains(&texts, "clipped: 78 values beyond the axis"), "{texts:?}");
    assert!(contains(&texts, "vertical axis does not begin at 0"), "{texts:?}");
    // Two periods above and three below the range.
    assert_eq!(elements(&svg, "polygon", ("fill", "#8E44AD")), 4);
}

#[test]
fn frequencies_have_a_logarithmic_axis_and_numbers_integers() {
    let drawn = |kind| {
        let points = [1.0, 2.0, 3.0, 40.0].map(|x| (x, Some(x))).to_vec();
        let series = vec![Series { name: "value".into(), tone: Tone::Actual, points }];
        let panel = CurvePanel { series, ..CurvePanel::default() };
        let stacks = vec![stack("x", kind, vec![(panel, 200)])];
        CurveFigure { stacks, ..CurveFigure::default() }.to_svg().unwrap()
    };
    let logarithmic = texts(&drawn(AxisKind::Logarithmic));
    for text in ["1", "2", "5", "10", "20", "x, logarithmic"] {
        assert!(contains(&logarithmic, text), "{text}: {logarithmic:?}");
    }
    let counts = texts(&drawn(AxisKind::Count));
    assert!(contains(&counts, "5") && !counts.iter().any(|text| text.contains('.')), "{counts:?}");
}

#[test]
fn picture_without_samples_is_valid() {
    let panel = CurvePanel {
        series: vec![Series { name: "value".into(), tone: Tone::Actual, points: Vec::new() }],
        marks: vec![Mark { seconds: 0.5, text: String::new(), is_fault: false }],
        mark_name: "reading missed".into(),
        ..CurvePanel::default()
    };
    let stacks = vec![stack("", AxisKind::Linear, vec![(panel, 200)])];
    let figure = CurveFigure { stacks, ..CurveFigure::default() };
    assert!(contains(&texts(&figure.to_svg().unwrap()), "reading missed (1)"));
    assert!(texts(&CurveFigure::default().to_svg().unwrap()).iter().all(String::is_empty));
    let svg = HistogramFigure::default().to_svg().unwrap();
    assert!(!svg.contains("NaN"), "{svg}");
}

#[test]
fn file_that_cannot_be_written_is_named() {
    let figure = CurveFigure::default();
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("picture.svg");
    figure.write(&path).unwrap();
    assert!(std::fs::read_to_string(path).unwrap().ends_with("</svg>\n"));
    let error = figure.write(&directory.path().join("none/picture.svg")).unwrap_err();
    assert!(matches!(error, PlotError::Write { .. }));
    assert!(error.to_string().contains("none/picture.svg"), "{error}");
}
