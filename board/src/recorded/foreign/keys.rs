//! Cameras in the lens files of OpenCV, Kalibr and ROS, which state the same values under different names.

use super::model::{Distortion, ForeignCamera, Model};
use super::tree::Node;
use super::{EXPECTED, Refusal, refuse};

const MATRIX: [&str; 10] = [
    "camera_matrix",
    "cameraMatrix",
    "K",
    "K1",
    "M1",
    "mtx",
    "intrinsic_matrix",
    "intrinsics_matrix",
    "cam_matrix",
    "KK",
];
const COEFFICIENTS: [&str; 10] = [
    "distortion_coefficients",
    "distortion_coeffs",
    "dist_coeffs",
    "distCoeffs",
    "dist_coeff",
    "D",
    "D1",
    "dist",
    "distortion",
    "kc",
];

/// Returns the camera that a tree of names and values describes.
pub(super) fn camera(tree: &Node, notes: &mut Vec<String>) -> Result<ForeignCamera, Refusal> {
    if let Some(node) = kalibr(tree, notes) {
        return of_kalibr(node);
    }
    let Some(matrix) = tree.get(&MATRIX) else {
        return refuse("no camera matrix and no intrinsics", EXPECTED);
    };
    let Some([fx, skew, cx, zero, fy, cy, ..]) = matrix.numbers().and_then(|v| <[f64; 9]>::try_from(v).ok())
    else {
        return refuse("a camera matrix that is not 3 x 3", "nine numbers");
    };
    if zero != 0.0 {
        return refuse(format!("{zero} in the second row of the camera matrix"), "0");
    }
    for name in ["binning_x", "binning_y"] {
        if let Some(binning) = tree.get(&[name]).and_then(Node::number).filter(|b| *b > 1.0) {
            return refuse(format!("{name} {binning}"), "a calibration of the whole image");
        }
    }
    let size = size(tree)?;
    check_region(tree, size)?;
    let k = match tree.get(&COEFFICIENTS) {
        Some(node) => {
            node.numbers().ok_or_else(|| ("distortion coefficients".to_string(), "numbers".to_string()))?
        }
        None => Vec::new(),
    };
    let name = model_name(tree);
    if name.is_none() && k.len() == 4 {
        notes.push(
            "four distortion coefficients without the name of a model are read as a fisheye's (fisheye_model: 0 in the file makes them a \
             pinhole's)"
                .into(),
        );
    }
    Ok(ForeignCamera { model: named(name.as_deref(), &k)?, size, focal: [fx, fy], centre: [cx, cy], skew })
}

/// Refuses a ROS region of interest that is not the whole image: the frames would cover a part of the calibrated image alone.
fn check_region(tree: &Node, size: [u32; 2]) -> Result<(), Refusal> {
    let Some(region) = tree.get(&["roi"]) else { return Ok(()) };
    let number = |name: &str| region.get(&[name]).and_then(Node::number).unwrap_or(0.0);
    let [x, y, width, height] = ["x_offset", "y_offset", "width", "height"].map(number);
    // A region of zeros is the whole image.
    let whole = [0.0, 0.0, f64::from(size[0]), f64::from(size[1])];
    if [x, y, width, height] == [0.0; 4] || [x, y, width, height] == whole {
        return Ok(());
    }
    let found = format!("the region of interest {width} x {height} at ({x}, {y})");
    refuse(found, "a calibration of the whole image")
}

/// Returns the first camera of a Kalibr camchain.
fn kalibr<'a>(tree: &'a Node, notes: &mut Vec<String>) -> Option<&'a Node> {
    if tree.get(&["intrinsics"]).is_some() {
        return Some(tree);
    }
    let Node::Map(entries) = tree else { return None };
    let cameras: Vec<_> = entries.iter().filter(|(_, node)| node.get(&["intrinsics"]).is_some()).collect();
    if cameras.len() > 1 {
        let names: Vec<_> = cameras.iter().map(|(name, _)| name.as_str()).collect();
        notes.push(format!("the first of the cameras {} is used", names.join(", ")));
    }
    cameras.first().map(|(_, node)| node)
}

fn of_kalibr(node: &Node) -> Result<ForeignCamera, Refusal> {
    let text = |name| node.get(&[name]).and_then(Node::text).unwrap_or_default();
    let numbers = |name| node.get(&[name]).and_then(Node::numbers).unwrap_or_default();
    let (kind, k, p) = (text("camera_model"), numbers("distortion_coeffs"), numbers("intrinsics"));
    let distorted = text("distortion_model");
    let radtan = || match (distorted, Distortion::from_opencv(&k)) {
        ("radtan", Some(d)) => Ok(d),
        ("none" | "", _) => Ok(Distortion::default()),
        _ => refuse(format!("the distortion model {distorted:?} of {kind:?}"), "radtan or none"),
    };
    let (model, rest) = match (kind, p.as_slice()) {
        ("pinhole", rest) => match (distorted, k.as_slice()) {
            ("fov", [w]) => (Model::FieldOfView(*w), rest),
            ("equidistant" | "equi", _) => (named(Some("equidistant"), &k)?, rest),
            _ => (Model::Pinhole(radtan()?), rest),
        },
        ("omni", [xi, rest @ ..]) => (Model::Omni(*xi, radtan()?), rest),
        ("eucm", [alpha, beta, rest @ ..]) => (Model::Eucm(*alpha, *beta), rest),
        ("ds", [xi, alpha, rest @ ..]) => (Model::DoubleSphere(*xi, *alpha), rest),
        _ => return refuse(format!("the camera model {kind:?}"), "pinhole, omni, eucm or ds"),
    };
    if matches!(model, Model::Eucm(..) | Model::DoubleSphere(..)) && !matches!(distorted, "none" | "") {
        return refuse(format!("the distortion model {distorted:?} of {kind:?}"), "none");
    }
    let &[fx, fy, cx, cy] = rest else {
        return refuse(
            format!("{} intrinsics of {kind:?}", p.len()),
            "four numbers after those of the model",
        );
    };
    Ok(ForeignCamera { model, size: size(node)?, focal: [fx, fy], centre: [cx, cy], skew: 0.0 })
}

/// Returns the columns and rows of the image.
fn size(tree: &Node) -> Result<[u32; 2], Refusal> {
    let one = |names: &[&str]| tree.get(names).and_then(Node::number);
    let pair = tree.get(&["image_size", "imageSize", "resolution", "size", "DIM", "dim"]).and_then(|node| {
        let sides = [node.get(&["width"]), node.get(&["height"])].map(|n| n.and_then(Node::number));
        match sides {
            [Some(width), Some(height)] => Some([width, height]),
            _ => node.numbers().and_then(|v| v.try_into().ok()),
        }
    });
    let sides =
        match (one(&["image_width", "imageWidth", "width"]), one(&["image_height", "imageHeight", "height"]))
        {
            (Some(width), Some(height)) => Some([width, height]),
            _ => pair,
        };
    match sides.filter(|s| s.iter().all(|v| (1.0..=65535.0).contains(v) && v.fract() == 0.0)) {
        Some(sides) => Ok(sides.map(|v| v as u32)),
        None => refuse("no image size", "image_width and image_height, pixels"),
    }
}

/// Returns the name of the distortion model; files of OpenCV's sample program state a fisheye by a flag.
fn model_name(tree: &Node) -> Option<String> {
    let is_fisheye = |name: &str| tree.get(&[name]).and_then(Node::number).map(|v| v != 0.0);
    match is_fisheye("fisheye_model").or_else(|| is_fisheye("fisheye")) {
        Some(true) => return Some("fisheye".into()),
        Some(false) => return Some("plumb_bob".into()),
        None => {}
    }
    tree.get(&["distortion_model", "camera_model", "model"]).and_then(Node::text).map(str::to_lowercase)
}

/// Returns the distortion model called `name`; without a name, four coefficients `k` are those of a fisheye, as OpenCV's `fisheye::calibrate`
/// returns them.
fn named(name: Option<&str>, k: &[f64]) -> Result<Model, Refusal> {
    let four = || <[f64; 4]>::try_from(k).map(Model::KannalaBrandt);
    let count = format!("{} distortion coefficients", k.len());
    match name {
        Some(
            "equidistant" | "fisheye" | "equi" | "kannala_brandt" | "kannala-brandt" | "kb4"
            | "opencv_fisheye",
        ) => four().or_else(|_| refuse(count, "four of a fisheye")),
        None if k.len() == 4 => four().or_else(|_| refuse(count, "four")),
        Some(
            "plumb_bob"
            | "radtan"
            | "rational_polynomial"
            | "pinhole"
            | "brown_conrady"
            | "opencv"
            | "standard"
            | "none",
        )
        | None => Distortion::from_opencv(k)
            .map(Model::Pinhole)
            .map_or_else(|| refuse(count, "4, 5 or 8 of a pinhole"), Ok),
        Some("fov") => match k {
            [w] => Ok(Model::FieldOfView(*w)),
            _ => refuse(count, "one of a field-of-view model"),
        },
        Some(other) => refuse(
            format!("the distortion model {other:?}"),
            "equidistant, fisheye, plumb_bob, rational_polynomial or fov",
        ),
    }
}
