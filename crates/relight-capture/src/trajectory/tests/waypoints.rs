use std::f64::consts::PI;

use glam::DVec3;
use proptest::prelude::*;

use super::super::dome::{Dome, DomeFault};
use super::super::plan::{Trajectory, Waypoint};
use super::super::visit::{length, visit_order};
use super::{any_region, region};

fn dome(cells: usize) -> Dome {
    Dome {
        region: region([48.0, 68.0], [-118.5, -61.5]),
        cells,
        centre: [0.1, 0.0, 0.02],
        radius: [0.602, 0.623],
        target: [0.1, 0.02, 0.08],
        roll: 0.0,
    }
}

fn position(waypoint: &Waypoint) -> DVec3 {
    waypoint.pose.position().into()
}

#[test]
fn waypoints_stand_over_their_cells_and_look_at_the_object() {
    let dome = dome(50);
    let waypoints = dome.waypoints().unwrap();
    assert_eq!(waypoints.len(), 50);
    for (label, waypoint) in waypoints.iter().enumerate() {
        assert_eq!(waypoint.label, label);
        let from_centre = position(waypoint) - DVec3::from(dome.centre);
        let radius = from_centre.length();
        assert!((0.602..=0.623).contains(&radius));
        let [colatitude, azimuth] = waypoint.cell.centre();
        assert!(((from_centre.z / radius).acos() - colatitude).abs() < 1e-12);
        assert!((from_centre.y.atan2(from_centre.x) - azimuth).abs() < 1e-12);
        let target = waypoint.pose.inverse_transform(dome.target);
        assert!(target[0].abs() < 1e-12 && target[1].abs() < 1e-12 && target[2] > 0.5);
        // Without roll the horizon is level.
        assert!(waypoint.pose.0[2][0].abs() < 1e-12 && waypoint.pose.0[2][1] < 0.0);
    }
}

#[test]
fn a_roll_turns_right_towards_down() {
    let plain = dome(7).waypoints().unwrap();
    let turned = Dome { roll: PI / 2.0, ..dome(7) }.waypoints().unwrap();
    for (plain, turned) in plain.iter().zip(&turned) {
        let axis = |waypoint: &Waypoint, axis: usize| DVec3::from(waypoint.pose.0.map(|row| row[axis]));
        assert!(axis(turned, 0).distance(axis(plain, 1)) < 1e-12, "X where Y was");
        assert!(axis(turned, 1).distance(-axis(plain, 0)) < 1e-12);
        assert_eq!(axis(turned, 2), axis(plain, 2));
        assert_eq!(position(turned), position(plain));
    }
}

#[test]
fn radii_fill_their_range_evenly() {
    let centre = DVec3::from(dome(1).centre);
    let waypoints = dome(200).waypoints().unwrap();
    let mut tenths = [0; 10];
    for waypoint in &waypoints {
        let share = (position(waypoint).distance(centre) - 0.602) / 0.021;
        tenths[(share * 10.0) as usize] += 1;
    }
    assert!(tenths.iter().all(|count| (18..=22).contains(count)), "{tenths:?}");
    let sphere = Dome { radius: [0.5, 0.5], ..dome(20) }.waypoints().unwrap();
    assert!(sphere.iter().all(|w| (position(w).distance(centre) - 0.5).abs() < 1e-12));
}

#[test]
fn domes_that_cannot_be_are_refused() {
    for radius in [[0.0, 0.5], [-1.0, 0.5], [0.6, 0.5], [f64::NAN, 0.5], [0.5, f64::INFINITY], [0.5, 1e9]] {
        let fault = Dome { radius, ..dome(5) }.waypoints().unwrap_err();
        assert!(matches!(fault, DomeFault::Radius(..)), "{fault}");
    }
    let fault = |dome: Dome| dome.waypoints().unwrap_err().to_string();
    assert!(fault(Dome { centre: [0.0, f64::NAN, 0.0], ..dome(5) }).contains("centre"));
    assert!(fault(Dome { target: [1e5, 0.0, 0.0], ..dome(5) }).contains("target"));
    assert!(fault(Dome { roll: f64::INFINITY, ..dome(5) }).contains("roll"));
    assert!(fault(dome(0)).contains("0 cells"));
    assert!(fault(dome(2001)).contains("2001 waypoints are too many: at most 2000"));
    let zenith = Dome { region: region([0.0, 10.0], [0.0, 360.0]), radius: [0.5; 2], ..dome(4) };
    assert!(
        fault(Dome { target: [0.1, 0.0, 0.52], ..zenith }).contains("waypoint 0 stands where it should look")
    );
}

fn rings_of(dome: &Dome) -> (Vec<Vec<usize>>, Vec<Waypoint>) {
    let waypoints = dome.waypoints().unwrap();
    let rings = waypoints.chunk_by(|a, b| a.cell.colatitude == b.cell.colatitude);
    (rings.map(|ring| ring.iter().map(|w| w.label).collect()).collect(), waypoints)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(100))]

    #[test]
    fn all_are_visited_once_and_no_way_is_longer_than_ring_by_ring(
        region in any_region(),
        cells in 1..80usize,
        stretch in prop::array::uniform3(0.05..3.0f64),
    ) {
        let dome = Dome { region, cells, target: [0.0; 3], centre: [0.0; 3], ..dome(1) };
        let (rings, waypoints) = rings_of(&dome);
        // A metric that is not that of space: the arm's joints have their own.
        let travel = |from: usize, to: usize| {
            ((position(&waypoints[from]) - position(&waypoints[to])) * DVec3::from(stretch)).abs().max_element()
        };
        let order = visit_order(&rings, &travel);
        let (plain, ours) = (length(&rings.concat(), &travel), length(&order, &travel));
        prop_assert!(ours <= plain + 1e-12, "{ours} against {plain}");
        prop_assert_eq!(&order, &visit_order(&rings, &travel), "the same each time");
        // No stretch is left whose reversal would shorten the way.
        for first in 0..cells {
            for end in first + 2..=cells {
                let mut other = order.clone();
                other[first..end].reverse();
                prop_assert!(ours <= length(&other, &travel) + 1e-9, "{first}..{end} of {order:?}");
            }
        }
        let mut sorted = order;
        sorted.sort_unstable();
        prop_assert!(sorted.into_iter().eq(0..cells));
    }
}

#[test]
fn the_way_over_few_waypoints_is_the_shortest() {
    // All orders of seven are tried. Not every local optimum is the shortest way; these are.
    for cells in 2..=7 {
        for region in [region([48.0, 68.0], [-118.5, -61.5]), region([0.0, 60.0], [0.0, 360.0])] {
            let (rings, waypoints) = rings_of(&Dome { region, ..dome(cells) });
            let travel =
                |from: usize, to: usize| position(&waypoints[from]).distance(position(&waypoints[to]));
            let ours = length(&visit_order(&rings, &travel), &travel);
            let shortest =
                permutations(cells).iter().map(|order| length(order, &travel)).fold(f64::MAX, f64::min);
            assert!(ours < shortest + 1e-9, "{cells}: {ours} against {shortest}");
        }
    }
}

fn permutations(count: usize) -> Vec<Vec<usize>> {
    if count == 0 {
        return vec![Vec::new()];
    }
    let shorter = permutations(count - 1);
    let with_last = |order: &Vec<usize>| {
        let insert = |place| [&order[..place], &[count - 1], &order[place..]].concat();
        (0..count).map(insert).collect::<Vec<_>>()
    };
    shorter.iter().flat_map(with_last).collect()
}

#[test]
fn tangled_ways_are_untangled() {
    // On a line the shortest way goes from end to end, whatever the start; metrics of one axis tie nowhere else.
    let scattered: Vec<f64> = (0..30).map(|i| (f64::from(i) * 0.618_034).fract()).collect();
    let travel = |from: usize, to: usize| (scattered[from] - scattered[to]).abs();
    let order = visit_order(&[(0..15).collect(), (15..30).collect()], &travel);
    let extent = scattered.iter().fold(0.0f64, |most, &v| most.max(v))
        - scattered.iter().fold(1.0f64, |least, &v| least.min(v));
    assert!((length(&order, &travel) - extent).abs() < 1e-12);
}

#[test]
fn unreachable_waypoints_are_left_out_of_the_order() {
    let mut trajectory = Trajectory::new(&dome(20)).unwrap();
    assert_eq!(trajectory.order.len(), 20);
    for label in [3, 17] {
        trajectory.waypoints[label].unreachable = Some("beyond the arm's reach".into());
    }
    trajectory.order_by(|from, to| position(from).distance(position(to)));
    let mut order = trajectory.order.clone();
    order.sort_unstable();
    assert!(order.into_iter().eq((0..20).filter(|label| ![3, 17].contains(label))));
    assert!(trajectory.visited().all(|waypoint| waypoint.unreachable.is_none()));
}
