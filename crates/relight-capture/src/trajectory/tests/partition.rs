use std::f64::consts::{PI, TAU};

use proptest::prelude::*;

use super::super::partition::{MAX_CELLS, Partition, PartitionError};
use super::super::region::Region;
use super::{any_region, region};

fn parted(region: &Region, cells: usize) -> Partition {
    Partition::new(region, cells).unwrap()
}

/// Bounds between the rings, and the colatitude of the centres in each.
fn colatitudes(partition: &Partition) -> (Vec<f64>, Vec<f64>) {
    let firsts = partition.rings.iter().scan(0, |above, &count| {
        *above += count;
        Some(partition.cells[*above - count])
    });
    firsts.map(|cell| (cell.colatitude[1], cell.centre()[0])).unzip()
}

fn assert_close(ours: &[f64], theirs: &[f64], tolerance: f64) {
    assert_eq!(ours.len(), theirs.len(), "{ours:?} {theirs:?}");
    for (a, b) in ours.iter().zip(theirs) {
        assert!((a - b).abs() <= tolerance, "{a} against {b}");
    }
}

#[test]
fn the_sphere_is_parted_as_in_the_paper() {
    // Kegerreis et al. 2019, upper half, degrees.
    type Row<'a> = (usize, &'a [usize], &'a [f64], &'a [f64]);
    let table: [Row; 3] = [
        (40, &[1, 7, 12, 12, 7, 1], &[18.19487, 53.13010, 90.0], &[0.0, 35.66249, 71.56505]),
        (50, &[1, 7, 11, 12, 11, 7, 1], &[16.26020, 47.15636, 76.11346], &[0.0, 31.70828, 61.63491, 90.0]),
        (
            100,
            &[1, 6, 11, 15, 17, 17, 15, 11, 6, 1],
            &[11.47834, 30.68342, 50.20818, 70.12313, 90.0],
            &[0.0, 21.08088, 40.44580, 60.16565, 80.06156],
        ),
    ];
    for (cells, rings, bounds, centres) in table {
        let partition = parted(&Region::SPHERE, cells);
        assert_eq!(partition.rings, rings);
        let (ours, middles) = colatitudes(&partition);
        let degrees = |values: &[f64]| values.iter().map(|v| v.to_degrees()).collect::<Vec<_>>();
        assert_close(&degrees(&ours)[..bounds.len()], bounds, 5.1e-6);
        assert_close(&degrees(&middles)[..centres.len()], centres, 5.1e-6);
    }
}

#[test]
fn the_sphere_is_parted_as_seagen_does() {
    for line in include_str!("../../../tests/golden/partition.txt").lines() {
        let fields: Vec<&str> = line.split("; ").collect();
        let numbers = |field: &str| field.split(' ').map(|v| v.parse::<f64>().unwrap()).collect::<Vec<f64>>();
        let partition = parted(&Region::SPHERE, fields[0].parse().unwrap());
        let rings: Vec<f64> = partition.rings.iter().map(|&count| count as f64).collect();
        assert_eq!(rings, numbers(fields[1]), "{} cells", fields[0]);
        let (bounds, centres) = colatitudes(&partition);
        assert_close(&bounds[..bounds.len() - 1], &numbers(fields[2]), 1e-13);
        assert_close(&centres, &numbers(fields[3]), 1e-13);
    }
}

#[test]
fn few_cells_part_the_sphere_too() {
    for (cells, rings) in [(1, vec![1]), (2, vec![1, 1]), (3, vec![1, 1, 1])] {
        assert_eq!(parted(&Region::SPHERE, cells).rings, rings);
    }
    assert_eq!(parted(&Region::SPHERE, 2).cells[1].centre()[0], PI);
}

/// The first ring is 0.496 times as high as a square of its area.
#[test]
fn a_ring_less_than_half_as_high_as_a_square_may_be_best() {
    let region = Region::new([0.122343297567043, 2.0445475276375396], [0.0, TAU]).unwrap();
    assert_eq!(parted(&region, 5).rings, [1, 4]);
}

/// Exactly N cells of one area, which cover the region without overlap, their centres inside, none degenerate.
fn check(region: &Region, cells: usize) {
    let Partition { rings, cells: parts } = parted(region, cells);
    assert_eq!((parts.len(), rings.iter().sum::<usize>()), (cells, cells));
    let share = region.area() / cells as f64;
    let mut rest = &parts[..];
    let mut top = region.colatitude()[0];
    for &count in &rings {
        let (ring, below) = rest.split_at(count);
        rest = below;
        // Each ring begins where the one above ended, and each cell where the one beside it did.
        let mut lo = region.azimuth()[0];
        for cell in ring {
            assert_eq!((cell.colatitude, cell.azimuth[0]), ([top, ring[0].colatitude[1]], lo));
            lo = cell.azimuth[1];
            let (height, width) = (cell.colatitude[1] - top, cell.azimuth[1] - cell.azimuth[0]);
            assert!(height > 0.0 && width > 0.0);
            // Angles are rounded to some 1e-16: what that does to an area is no fault of the partition.
            let rounding = 4.0 * f64::EPSILON * (TAU * height + PI * width);
            let direct = width * (cell.colatitude[0].cos() - cell.colatitude[1].cos());
            assert!((cell.area() - share).abs() <= 1e-12 * share + rounding, "{} of {share}", cell.area());
            assert!((direct - share).abs() <= 1e-12, "{direct} of {share}");
            let [colatitude, azimuth] = cell.centre();
            assert!(cell.colatitude[0] <= colatitude && colatitude <= cell.colatitude[1]);
            assert!(cell.azimuth[0] < azimuth && azimuth < cell.azimuth[1]);
        }
        assert_eq!(lo, region.azimuth()[1]);
        top = ring[0].colatitude[1];
    }
    assert_eq!(top, region.colatitude()[1]);
    // Caps where the region holds a pole, and nowhere else.
    let [zenith, nadir] = region.holds_poles();
    for (index, cell) in parts.iter().enumerate() {
        let expected = (zenith && index == 0) || (nadir && index + 1 == cells);
        assert_eq!(cell.is_cap(), expected, "{cell:?}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn cells_are_equal_and_cover_the_region(region in any_region(), cells in prop_oneof![1..60usize, 1..5000usize]) {
        check(&region, cells);
    }

    #[test]
    fn the_sphere_is_covered_too(cells in 1..5000usize) {
        check(&Region::SPHERE, cells);
    }

    #[test]
    fn no_other_rings_are_squarer(region in any_region(), cells in 1..13usize) {
        prop_assume!(region.holds_poles() == [false; 2]);
        let partition = parted(&region, cells);
        let bounds = bounds_of(&region, cells);
        let ours = summed(&partition.rings, &region, &bounds);
        // A bit for each place between cells: whether a ring ends there.
        for ends in 0..1u32 << (cells - 1) {
            let mut rings = vec![1];
            for place in 0..cells - 1 {
                if ends >> place & 1 == 1 { rings.push(1) } else { *rings.last_mut().unwrap() += 1 }
            }
            let theirs = summed(&rings, &region, &bounds);
            prop_assert!(ours <= theirs * (1.0 + 1e-9), "{:?} against {rings:?}", partition.rings);
        }
    }

    #[test]
    fn rings_left_untried_would_not_be_squarer(region in any_region(), cells in 15..400usize) {
        prop_assume!(region.holds_poles() == [false; 2]);
        let bounds = bounds_of(&region, cells);
        let mut least = vec![f64::INFINITY; cells + 1];
        least[0] = 0.0;
        for above in 0..cells {
            for end in above + 1..=cells {
                let sum = least[above] + elongation(&region, cells, end - above, [bounds[above], bounds[end]]);
                least[end] = least[end].min(sum);
            }
        }
        let ours = summed(&parted(&region, cells).rings, &region, &bounds);
        prop_assert!(ours <= least[cells] * (1.0 + 1e-9), "{ours} against {}", least[cells]);
    }
}

/// The cells' squared perimeters over their areas, summed over the rings.
fn summed(rings: &[usize], region: &Region, bounds: &[f64]) -> f64 {
    let cells = rings.iter().sum();
    let mut above = 0;
    let each = rings.iter().map(|&count| {
        above += count;
        elongation(region, cells, count, [bounds[above - count], bounds[above]])
    });
    each.sum()
}

/// What a ring of `count` cells adds to that, each taken for a rectangle.
fn elongation(region: &Region, cells: usize, count: usize, [top, bottom]: [f64; 2]) -> f64 {
    let area = region.area() / cells as f64;
    let (height, width) = (bottom - top, area / (bottom - top));
    count as f64 * (2.0 * (height + width)).powi(2) / area
}

/// Where `0..=cells` cells end, by plain trigonometry.
fn bounds_of(region: &Region, cells: usize) -> Vec<f64> {
    let [top, bottom] = region.colatitude();
    let height = 2.0 * ((top + bottom) / 2.0).sin() * ((bottom - top) / 2.0).sin();
    let bound = |above: usize| {
        let share = above as f64 / cells as f64;
        // Newton's method from a linear guess: 1 - cos is no use in thin regions.
        let mut colatitude = top + share * (bottom - top);
        for _ in 0..40 {
            let area = 2.0 * ((top + colatitude) / 2.0).sin() * ((colatitude - top) / 2.0).sin();
            let slope = colatitude.sin().max(1e-9);
            colatitude = (colatitude - (area - share * height) / slope).clamp(top, bottom);
        }
        colatitude
    };
    (0..=cells).map(bound).collect()
}

#[test]
fn cells_are_about_square() {
    let dome = region([5.0, 43.0], [0.0, 360.0]);
    assert_eq!(parted(&dome, 40).rings.len(), 3, "three rings, as the real rig's lights");
    for (region, cells) in [
        (region([48.0, 68.0], [-118.5, -61.5]), 50),
        (dome, 40),
        (region([0.0, 90.0], [0.0, 360.0]), 100),
        (region([30.0, 150.0], [0.0, 90.0]), 1000),
        (region([100.0, 180.0], [-180.0, 180.0]), 333),
    ] {
        for cell in parted(&region, cells).cells.iter().filter(|cell| !cell.is_cap()) {
            let width = (cell.azimuth[1] - cell.azimuth[0]) * cell.centre()[0].sin();
            let aspect = width / (cell.colatitude[1] - cell.colatitude[0]);
            assert!((0.6..1.7).contains(&aspect), "{cells} cells of {region:?}: {aspect}");
        }
    }
}

#[test]
fn many_cells_of_a_belt_are_one_ring() {
    assert_eq!(parted(&region([89.9999, 90.0001], [0.0, 360.0]), 3000).rings, [3000]);
    assert_eq!(parted(&region([10.0, 170.0], [0.0, 1e-3]), 3000).rings, vec![1; 3000]);
}

#[test]
fn regions_and_counts_that_cannot_be_are_refused() {
    let fault = |colatitude: [f64; 2], azimuth: [f64; 2]| {
        let radians = |range: [f64; 2]| range.map(f64::to_radians);
        Region::new(radians(colatitude), radians(azimuth)).unwrap_err().to_string()
    };
    let whole = [0.0, 360.0];
    for (colatitude, azimuth, says) in [
        ([f64::NAN, 90.0], whole, "colatitude range holds a bound that is not a finite number"),
        ([0.0, 90.0], [0.0, f64::INFINITY], "azimuth range holds a bound"),
        ([30.0, 20.0], whole, "colatitude range 30 to 20 degrees is reversed"),
        ([0.0, 90.0], [57.1, -1.0], "azimuth range 57.1 to -1 degrees is reversed"),
        ([30.0, 30.0], whole, "colatitude range 30 to 30 degrees is empty"),
        ([0.0, 90.0], [10.0, 10.000001], "azimuth range 10 to 10.000001 degrees is empty"),
        ([-1.0, 90.0], whole, "leaves 0..180"),
        ([0.0, 180.1], whole, "leaves 0..180"),
        ([0.0, 90.0], [-400.0, -390.0], "leaves -360..720"),
        ([0.0, 90.0], [0.0, 361.0], "more than a full turn"),
    ] {
        let said = fault(colatitude, azimuth);
        assert!(said.contains(says), "{said}");
    }
    assert_eq!(Partition::new(&Region::SPHERE, 0), Err(PartitionError::NoCells));
    assert_eq!(Partition::new(&Region::SPHERE, usize::MAX), Err(PartitionError::TooManyCells(usize::MAX)));
    assert_eq!(parted(&Region::SPHERE, MAX_CELLS).cells.len(), MAX_CELLS);
}
