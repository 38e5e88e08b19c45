//! The object dictionary compared with every row of the manual's tables, if the manual is available.

use std::path::Path;

use ecan_protocol::object::{Access, ObjectType, objects};

/// One row of a "SI Name Type Access [Default] Description" table.
struct Row {
    subindex: u8,
    name: String,
    ty: ObjectType,
    access: Access,
    default: Option<String>,
}

fn parse_row(line: &str, has_default: bool) -> Option<Row> {
    let words: Vec<&str> = line.split_whitespace().collect();
    let subindex = words.first()?.parse().ok()?;
    let access_at = words.iter().position(|word| matches!(*word, "RO" | "RW" | "WO"))?;
    let ty = match *words.get(access_at.checked_sub(1)?)? {
        "U8" => ObjectType::U8,
        "U16" => ObjectType::U16,
        "U32" => ObjectType::U32,
        "I32" => ObjectType::I32,
        _ => return None,
    };
    Some(Row {
        subindex,
        name: words[1..access_at - 1].join(" "),
        ty,
        access: match words[access_at] {
            "RO" => Access::Ro,
            "RW" => Access::Rw,
            _ => Access::Wo,
        },
        default: has_default.then(|| words[access_at + 1].to_string()),
    })
}

fn number(text: &str) -> Option<u32> {
    match text.strip_prefix("0x") {
        Some(hex) => u32::from_str_radix(hex, 16).ok(),
        None => text.parse().ok(),
    }
}

#[test]
fn every_row_of_chapter_13_is_in_the_table() {
    let path =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/manual/ecan-lite-manual-v2.2.txt");
    let Ok(manual) = std::fs::read_to_string(&path) else {
        println!("skipped: the manual is not at {}", path.display());
        return;
    };
    let mut chapter = "";
    let mut has_default = None;
    let mut rows = 0;
    for line in manual.lines() {
        let heading = line.split(' ').next().unwrap_or_default();
        if heading.starts_with("13.") && heading.len() < 8 {
            chapter = heading;
            has_default = None;
        } else if line.starts_with("14. ") {
            chapter = "";
        } else if line.starts_with("SI Name Type Access") {
            has_default = Some(line.contains("Default"));
        } else if line.starts_with("SI decimal") {
            has_default = None;
        }
        let (false, Some(has_default)) = (chapter.is_empty(), has_default) else {
            continue;
        };
        let Some(row) = parse_row(line, has_default) else {
            continue;
        };
        let described: Vec<_> = objects().iter().filter(|o| o.chapter == chapter).collect();
        assert!(!described.is_empty(), "no object for chapter {chapter}");
        for object in described {
            let place = format!("{} {line}", object.name);
            let entry = object.entry(row.subindex).expect(&place);
            assert_eq!(entry.name, row.name, "{place}");
            assert_eq!((entry.ty, entry.access), (row.ty, row.access), "{place}");
            match row.default.as_deref() {
                Some("runtime") => assert_eq!(entry.default, None, "{place}"),
                Some(default) => assert_eq!(entry.default, number(default), "{place}"),
                None => {}
            }
            rows += 1;
        }
    }
    // 14+86+16+16+10+20+10+16+24+20+7+12+32 rows, and 7+18+14 of 13.4 that it lists twice.
    assert_eq!(rows, 283 + 39);
}
