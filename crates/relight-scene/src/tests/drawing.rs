use crate::drawing::{BACKGROUND, Canvas, Colour, View};
use crate::{Image, Intrinsics, Pose};

const WHITE: Colour = [255; 3];

fn at(image: &Image, x: u32, y: u32) -> Colour {
    let start = 3 * (y * image.width + x) as usize;
    image.data[start..start + 3].try_into().unwrap()
}

fn drawn(width: u32, height: u32, draw: impl FnOnce(&mut Canvas)) -> Image {
    let mut canvas = Canvas::new(width, height);
    draw(&mut canvas);
    canvas.into_image()
}

/// How much of a picture is covered, pixels.
fn ink(image: &Image) -> f64 {
    let share = |&value: &u8| f64::from(value - BACKGROUND[0]) / f64::from(255 - BACKGROUND[0]);
    image.data.iter().map(share).sum::<f64>() / 3.0
}

#[test]
fn lines_cover_their_width_times_their_length() {
    for (from, to) in [([5.0, 20.0], [35.0, 20.0]), ([20.0, 35.0], [20.0, 5.0]), ([8.0, 6.0], [30.0, 33.0])] {
        let image = drawn(41, 41, |canvas| canvas.line(from, to, 3.0, WHITE));
        let length = (to[0] - from[0]).hypot(to[1] - from[1]);
        let expected = 3.0 * length + std::f64::consts::PI * 1.5 * 1.5;
        assert!((ink(&image) / expected - 1.0).abs() < 0.03, "{} of {expected}", ink(&image));
        let middle = [0, 1].map(|axis| ((from[axis] + to[axis]) / 2.0).round() as u32);
        assert_eq!(at(&image, middle[0], middle[1]), WHITE);
    }
    let disc = drawn(41, 41, |canvas| canvas.disc([20.0, 20.0], 9.0, WHITE));
    assert!((ink(&disc) / (std::f64::consts::PI * 81.0) - 1.0).abs() < 0.01);
}

#[test]
fn what_lies_outside_is_left_out() {
    let image = drawn(10, 10, |canvas| {
        canvas.line([-1e9, 4.0], [1e9, 4.0], 1.0, WHITE);
        canvas.line([4.0, -1e300], [4.0, 1e300], 1.0, WHITE);
        canvas.line([f64::NAN, 0.0], [9.0, 9.0], 1.0, WHITE);
        canvas.line([f64::INFINITY, 0.0], [9.0, 9.0], 1.0, WHITE);
        canvas.disc([1e300, 5.0], 3.0, WHITE);
        canvas.text("outside", -1e6, 1e12, WHITE);
    });
    for x in 0..10 {
        assert_eq!(at(&image, x, 4), WHITE);
    }
    assert_eq!(ink(&image), 10.0, "nothing but the first line");
}

#[test]
fn letters_stand_where_they_are_put() {
    let width = Canvas::text_width("|__");
    let image = drawn(width, Canvas::TEXT_HEIGHT, |canvas| canvas.text("|__", 0.0, 0.0, WHITE));
    let column = |x: u32| (0..image.height).filter(|&y| at(&image, x, y) != BACKGROUND).count();
    let bar = (0..width / 3).map(column).max().unwrap();
    assert!(bar > 8, "upright in the first place");
    assert!((width / 3..width).all(|x| (1..4).contains(&column(x))), "flat in the others");
    let gap = drawn(width, 16, |canvas| canvas.text("\u{2603}\n ", 0.0, 0.0, WHITE));
    assert_eq!(ink(&gap), 0.0);
}

#[test]
fn views_place_the_world_without_perspective() {
    let above = View::new([0.0, 0.0, 1.0], [1.0, 2.0, 0.0], [50.0, 60.0], 10.0);
    assert_eq!(above.place([1.0, 2.0, 7.0]), [50.0, 60.0]);
    assert_eq!(above.place([2.0, 4.0, 0.0]), [60.0, 40.0], "+X right, +Y up");
    assert_eq!(above.nearness([0.0, 0.0, 3.0]), 3.0);
    let side = View::new([2.0, 0.0, 0.0], [0.0; 3], [0.0; 2], 1.0);
    assert_eq!(side.place([5.0, 3.0, 4.0]), [3.0, -4.0]);
    assert_eq!(side.nearness([5.0, 3.0, 4.0]), 5.0);
    let points = [[0.0, 0.0, 0.0], [4.0, 1.0, -9.0], [1.0, 2.0, 3.0]];
    let fitted = View::fitting([0.0, 0.0, 1.0], &points, [120, 50], 5.0);
    assert_eq!(fitted.pixels_a_metre(), 20.0);
    assert_eq!(fitted.place([0.0, 0.0, 0.0]), [20.0, 45.0]);
    assert_eq!(fitted.place([4.0, 2.0, 0.0]), [100.0, 5.0]);
}

#[test]
fn a_camera_opens_towards_what_it_sees() {
    let lens =
        Intrinsics { width: 101, height: 51, fx: 50.0, fy: 50.0, cx: 50.0, cy: 25.0, distortion: Vec::new() };
    let pose = Pose::look_at([-2.0, 0.0, 0.0], [0.0; 3]);
    let view = View::new([0.0, 0.0, 1.0], [0.0; 3], [50.0, 50.0], 20.0);
    let image = drawn(101, 101, |canvas| view.camera(canvas, &pose, &lens, 1.0, 1.0, WHITE));
    // Its tip at -2 m, and the image 1 m ahead reaching 1 m to each side.
    for (x, y) in [(10, 50), (30, 30), (30, 70), (30, 50)] {
        assert_eq!(at(&image, x, y), WHITE, "{x}, {y}");
    }
    assert_eq!(at(&image, 50, 50), BACKGROUND);
}

#[test]
fn a_pose_and_its_matrix_are_the_same() {
    let pose = Pose::look_at([1.0, 2.0, 3.0], [0.5, 0.0, 0.0]);
    let matrix = pose.to_matrix();
    assert_eq!([matrix[3], matrix[7], matrix[11]], [1.0, 2.0, 3.0]);
    assert_eq!(Pose::from_matrix(&matrix), Ok(pose));
}
