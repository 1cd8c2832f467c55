//! OME-XML, whole and damaged, and its description.

use super::*;
use crate::testing::{is_warned, said};
use brickyard_volume::TimeAxis;

const OME: &str = r#"<?xml version="1.0"?><!-- <OME/> a > b --><OME xmlns="x"><Image ID="Image:0"><ome:Pixels ID="Pixels:0 > 1"
    DimensionOrder="XYZCT" SizeX = "7" SizeY="5" SizeZ="4" SizeC="2" SizeT='3' Type="uint16" PhysicalSizeX="0.5"
    PhysicalSizeY="500" PhysicalSizeYUnit="nm" PhysicalSizeZ="2"><Channel ID="c" SamplesPerPixel="1"/>INSIDE</ome:Pixels></Image></OME>"#;

fn described(inside: &str) -> Description {
    read(OME.replace("INSIDE", inside).as_bytes()).unwrap().unwrap()
}

fn pixels(inside: &str) -> Pixels {
    match described(inside).ome.unwrap().says {
        OmeSays::Pixels(pixels) => *pixels,
        says => panic!("{says:?}"),
    }
}

fn problem(text: &str) -> String {
    match read(text.as_bytes()) {
        Err(Failure::Meaning(problem)) => problem,
        read => panic!("{read:?}"),
    }
}

#[test]
fn order_and_sizes_are_those_of_pixels() {
    let d = described("");
    let declared = d.declared.unwrap();
    assert_eq!(declared.page_axes, [Axis::T, Axis::C, Axis::Z]);
    assert_eq!((declared.z, declared.channels, declared.times, declared.plane), (4, 2, 3, Some([7, 5])));
    let spacing = d.spacing.unwrap();
    assert!((spacing.y - 0.5).abs() < 1e-12, "{spacing:?}");
    assert_eq!((spacing.x, spacing.z, d.unit), (0.5, Some(2.0), Some("micrometer")));
}

#[test]
fn comments_and_annotations_are_no_elements() {
    let inside = "<!-- <TiffData IFD=\"9\"/> --><Note><![CDATA[<TiffData IFD=\"8\"/>]]><TiffData IFD=\"7\"/></Note>";
    assert_eq!(pixels(inside).tiff_data, []);
}

#[test]
fn places_of_planes_have_the_schemas_defaults() {
    let of = |text: &str| pixels(text).tiff_data[0];
    let none = TiffData { first: [0; 3], ifd: None, count: None, part: None };
    assert_eq!(of("<TiffData/>"), none);
    assert_eq!(of("<TiffData IFD='4' FirstC=\"1\"/>"), TiffData { ifd: Some(4), first: [0, 1, 0], ..none });
    assert_eq!(of("<TiffData FirstT='2' FirstZ='3' PlaneCount='5'/>").count, Some(5));
    assert_eq!(of("<TiffData NumPlanes='6' PlaneCount='0'></TiffData>"), none);
    let set = "<TiffData><UUID FileName='a&amp;b.tif'> urn:1 </UUID></TiffData>\
               <TiffData IFD='1'><UUID FileName='a&amp;b.tif'><![CDATA[urn:1]]></UUID></TiffData>\
               <TiffData><UUID>urn:2</UUID></TiffData>";
    let pixels = pixels(set);
    assert_eq!(pixels.parts[0], Part { uuid: "urn:1".into(), name: Some("a&b.tif".into()) });
    assert_eq!(pixels.parts[1], Part { uuid: "urn:2".into(), name: None });
    assert_eq!(pixels.tiff_data.iter().map(|d| d.part).collect::<Vec<_>>(), [Some(0), Some(0), Some(1)]);
}

#[test]
fn metadata_may_be_in_another_file() {
    let text = "<OME UUID='urn:1'><BinaryOnly MetadataFile='s.companion.ome' UUID='urn:2'/></OME>";
    let ome = read(text.as_bytes()).unwrap().unwrap().ome.unwrap();
    let says = OmeSays::Elsewhere { metadata_file: "s.companion.ome".into(), uuid: Some("urn:2".into()) };
    assert_eq!((ome.uuid.as_deref(), ome.says), (Some("urn:1"), says));
    assert!(problem("<OME><BinaryOnly/></OME>").contains("no MetadataFile"));
}

#[test]
fn names_and_colours_are_those_of_channels() {
    let named = ChannelLook { name: Some("A & µ<".into()), color: Some([255, 0, 0]), window: None, unit: None };
    let d = described(r#"<Channel ID="d" Name=" A &amp; &#181;&lt;" Color="-16776961"/>"#);
    assert_eq!(d.channel_looks, [ChannelLook::default(), named]);
    assert!(problem(&OME.replace("INSIDE", "<Channel SamplesPerPixel='3'/>")).contains("different SamplesPerPixel"));
}

#[test]
fn times_are_increments_or_stamps() {
    let axis = |step, unit: &str| Some(TimeAxis { step, unit: Some(unit.into()), ..TimeAxis::default() });
    let text = OME.replace("PhysicalSizeX", r#"TimeIncrement="40" TimeIncrementUnit="ms" PhysicalSizeX"#);
    assert_eq!(read(text.as_bytes()).unwrap().unwrap().time, axis(40.0, "millisecond"));
    let planes = |stamps: [f64; 3]| {
        let plane = |(t, stamp)| {
            format!(r#"<Plane TheT="{t}" TheZ="0" TheC="0" DeltaT="{stamp}"/><Plane TheT="{t}" TheZ="1" DeltaT="77"/>"#)
        };
        described(&(0..3).zip(stamps).map(plane).collect::<String>())
    };
    assert_eq!(planes([0.0, 1.5, 3.0]).time, axis(1.5, "second"));
    let irregular = planes([1.0, 1.5, 9.0]).time.unwrap();
    assert_eq!((irregular.stamps, irregular.unit.as_deref()), (vec![1.0, 1.5, 9.0], Some("second")));
    let back = planes([1.0, 0.5, 9.0]);
    assert!(back.time.is_none() && back.notes[0].contains("0.5 of step 1 after 1 of step 0"), "{:?}", back.notes);
    assert!(is_warned(&said(&back.notes), "0.5 of step 1 after 1 of step 0"));
    assert_eq!(described("").time, None);
}

#[test]
fn several_images_are_told() {
    let text = OME.replace("</OME>", r#"<Image ID="i" Name="overview"><Pixels/></Image></OME>"#);
    let problem = read(text.as_bytes()).unwrap().unwrap().problem.unwrap();
    assert!(problem.contains("2 images, number 0 to 'overview'"), "{problem}");
}

#[test]
fn what_is_damaged_or_too_large_is_named() {
    for (text, words) in [
        (OME[..OME.len() - 6].to_owned(), "cut short"),
        (OME[..OME.len() - 9].to_owned(), "not well-formed"),
        (OME.replace("INSIDE", "<TiffData IFD='x'/>"), "TiffData whose IFD is 'x'"),
        (OME.replace("INSIDE", "<TiffData IFD='-1'/>"), "TiffData whose IFD is '-1'"),
        (OME.replace("XYZCT", "XYZCZ"), "DimensionOrder is 'XYZCZ'"),
        (OME.replace("SizeZ=\"4\"", ""), "without a SizeZ"),
        (OME.replace("INSIDE", "<a></b>"), "not well-formed"),
        (OME.replace("INSIDE", &"<a>".repeat(300)), "more than 256 deep"),
        (OME.replace("INSIDE", &format!("<a b='{}'/>", "x".repeat(17 << 20))), "more than 16 MiB"),
        (OME.replace("INSIDE", &"<a/>".repeat(1 << 22)), "more than 4194304 elements"),
        (OME.replace("INSIDE", "<BinData/>"), "BinData"),
        (OME.replace("<OME xmlns", "<!DOCTYPE a [<!ENTITY b 'c'>]><OME UUID='&b;' xmlns"), "not well-formed"),
    ] {
        match read(text.as_bytes()) {
            Err(Failure::Meaning(problem)) => assert!(problem.contains(words), "{problem}"),
            read => panic!("{words}: {read:?}"),
        }
    }
}

#[test]
fn other_text_means_nothing() {
    for text in [
        "",
        "a plain remark",
        "<svg></svg>",
        "<Pixels",
        "<Pixels SizeX=>",
        "<a/>",
        "<!-- <OME/>",
        "<!DOCTYPE html><html/>",
    ] {
        assert!(matches!(read(text.as_bytes()), Ok(None)), "{text}");
    }
}
