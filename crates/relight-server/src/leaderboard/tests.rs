use proptest::prelude::*;

use super::*;
use crate::scoring::ImageScore;

/// Scores by scene, and in a scene by split, of image after image: PSNR and SSIM.
type Rows<'a> = &'a [(&'a str, Split, &'a [(f64, f64)])];

fn scores(rows: Rows<'_>) -> Scores {
    let of_row = |&(scene, split, values): &(&str, Split, &[(f64, f64)])| {
        let scene = scene.to_owned();
        let image = move |(camera, &(psnr, ssim))| ImageScore {
            scene: scene.clone(),
            split,
            camera,
            light: 7,
            psnr,
            ssim,
        };
        values.iter().enumerate().map(image).collect::<Vec<_>>()
    };
    Scores::of(rows.iter().flat_map(of_row).collect())
}

fn entry(id: &str, scores: Scores) -> Entry {
    let about = About { id: id.into(), method: format!("method {id}"), ..About::default() };
    Entry { about: Arc::new(about), intervals: Intervals::of(&scores), scores: Arc::new(scores) }
}

fn scenes(names: &[&str]) -> Vec<(String, [usize; 3])> {
    names.iter().map(|name| ((*name).to_owned(), [1, 2, 0])).collect()
}

/// Two scenes, three entries; easy has two images a scene, val one.
fn example() -> Leaderboard {
    let of = |apple: [(f64, f64); 2], cube: [(f64, f64); 2]| {
        scores(&[("apple", Split::Easy, &apple), ("cube", Split::Easy, &cube)])
    };
    let entries = [
        entry("a", of([(20.0, 0.5), (22.0, 0.7)], [(30.0, 0.8), (30.04, 0.9)])),
        entry("b", of([(24.0, 0.5), (26.0, 0.7)], [(20.0, 0.4), (20.0, 0.4)])),
        entry("c", of([(21.0, 0.6), (21.0, 0.6)], [(10.0, 0.3), (12.0, 0.5)])),
    ];
    Leaderboard::new("rene", &scenes(&["apple", "cube"]), &entries)
}

#[test]
fn means_and_ranks_are_those_worked_out_by_hand() {
    let board = example();
    // No hard images in this benchmark; nobody has shown validation images.
    assert_eq!(board.tables.iter().map(|table| table.split).collect::<Vec<_>>(), [Split::Val, Split::Easy]);
    assert_eq!(board.table(Split::Val).unwrap().rows.len(), 0);
    let table = board.table(Split::Easy).unwrap();
    assert_eq!((table.images, table.scenes.len()), (4, 2));
    let told = |metric| -> Vec<(Option<f64>, Vec<Option<f64>>, f64)> {
        let standings = table.rows.iter().map(|row| row.standing(metric));
        standings.map(|of| (of.mean, of.scenes.clone(), of.rank)).collect()
    };
    // apple: b 25, then a and c at 21 share ranks 2 and 3. cube: a, b, c.
    assert_eq!(
        told(Metric::Psnr),
        [
            (Some(25.51), vec![Some(21.0), Some(30.02)], 1.75),
            (Some(22.5), vec![Some(25.0), Some(20.0)], 1.5),
            (Some(16.0), vec![Some(21.0), Some(11.0)], 2.75),
        ]
    );
    // apple: all 0.6, rank 2 each. cube: 0.85, then b and c at 0.4.
    assert_eq!(
        told(Metric::Ssim),
        [
            (Some(0.725), vec![Some(0.6), Some(0.85)], 1.5),
            (Some(0.5), vec![Some(0.6), Some(0.4)], 2.25),
            (Some(0.5), vec![Some(0.6), Some(0.4)], 2.25),
        ]
    );
}

#[test]
fn the_interval_of_two_images_is_known() {
    // The mean of two draws from {20, 22} is 20, 21 or 22, with odds 1:2:1: the ends are the extremes. Both scenes must come out
    // low together for the mean's lowest, 25.51 - 0.51, which happens once in 16 times: more often than once in 40.
    let row = example().tables[1].rows[0].clone();
    assert_eq!(row.standing(Metric::Psnr).interval, Some((25.0, 26.02)));
    // Equal images, an interval of no width.
    let equal = scores(&[("apple", Split::Easy, &[(20.3, 0.3); 7])]);
    for (low, high) in deviations(&equal.images, Split::Easy).map(Option::unwrap) {
        assert!(low == high && low.abs() < 1e-12, "{low} {high}");
    }
}

#[test]
fn many_images_have_the_interval_of_the_normal_distribution() {
    // 400 images, half at 20 and half at 30: the mean's standard deviation is 5 / sqrt(400) = 0.25, and 1.96 of it 0.49.
    let images: Vec<(f64, f64)> = (0..400).map(|i| (20.0 + 10.0 * f64::from(i % 2), 0.5)).collect();
    let [psnr, _] = deviations(&scores(&[("apple", Split::Easy, &images)]).images, Split::Easy);
    let (low, high) = psnr.unwrap();
    assert!((low + 0.49).abs() < 0.04 && (high - 0.49).abs() < 0.04, "{low} {high}");
    // Four such scenes, drawn apart: half as wide. Drawn alike they would be as wide as one.
    let names = ["a", "b", "c", "d"];
    let four: Vec<_> = names.iter().map(|name| (*name, Split::Easy, images.as_slice())).collect();
    let [psnr, _] = deviations(&scores(&four).images, Split::Easy);
    let (low, high) = psnr.unwrap();
    assert!((low + 0.245).abs() < 0.02 && (high - 0.245).abs() < 0.02, "{low} {high}");
}

#[test]
fn equal_pictures_are_infinitely_good_and_stand_first() {
    let of = |psnr| scores(&[("apple", Split::Easy, &[(psnr, 1.0), (30.0, 0.9)])]);
    let entries = [entry("a", of(40.0)), entry("b", of(f64::INFINITY))];
    let board = Leaderboard::new("rene", &scenes(&["apple"]), &entries);
    let table = board.table(Split::Easy).unwrap();
    let best = table.rows[1].standing(Metric::Psnr);
    assert_eq!((best.mean, best.interval, best.rank), (None, None, 1.0));
    assert_eq!(Metric::Psnr.show(best.mean), "∞");
    let view = View::new(&board, &ViewQuery::default()).unwrap();
    assert_eq!(view.rows(table)[0].about.id, "b");
    let json = serde_json::to_value(to_json(&board, &ViewQuery::default()).unwrap()).unwrap();
    assert!(json["splits"][1]["entries"][0]["psnr"]["mean"].is_null());
    assert!(to_csv(&board, &ViewQuery::default()).unwrap().contains(",inf,,,1.00,"));
}

#[test]
fn whoever_lacks_a_scene_is_not_in_the_table() {
    let partial = entry("a", scores(&[("apple", Split::Easy, &[(20.0, 0.5)])]));
    let board = Leaderboard::new("rene", &scenes(&["apple", "cube"]), &[partial]);
    assert_eq!(board.table(Split::Easy).unwrap().rows.len(), 0);
}

#[test]
fn hidden_digits_are_nowhere_in_what_leaves() {
    let secret = scores(&[("apple", Split::Easy, &[(25.123_456, 0.612_345); 3])]);
    let board = Leaderboard::new("rene", &scenes(&["apple"]), &[entry("a", secret)]);
    let query = ViewQuery::default();
    let json = serde_json::to_string(&to_json(&board, &query).unwrap()).unwrap();
    for text in [json, to_csv(&board, &query).unwrap(), format!("{board:?}")] {
        assert!(text.contains("25.12") && text.contains("0.612"), "{text}");
        assert!(!text.contains("25.123") && !text.contains("0.6123"), "{text}");
    }
}

#[test]
fn views_sort_filter_and_pin() {
    let mut entries: Vec<Entry> = ["a", "b", "c"]
        .iter()
        .zip([20.0, 30.0, 25.0])
        .map(|(id, psnr)| entry(id, scores(&[("apple", Split::Easy, &[(psnr, 0.5)])])))
        .collect();
    // The best of all is a baseline.
    Arc::make_mut(&mut entries[1].about).baseline = true;
    Arc::make_mut(&mut entries[2].about).authors = "Ada Lovelace".into();
    let board = Leaderboard::new("rene", &scenes(&["apple"]), &entries);
    let table = board.table(Split::Easy).unwrap();
    let order = |sort: &str, order: &str, q: &str| -> Result<String, ViewError> {
        let some = |text: &str| (!text.is_empty()).then(|| text.to_owned());
        let query = ViewQuery { sort: some(sort), order: some(order), q: some(q), ..ViewQuery::default() };
        let view = View::new(&board, &query)?;
        Ok(view.rows(table).iter().map(|row| row.about.id.as_str()).collect())
    };
    assert_eq!(order("", "", "").unwrap(), "cab");
    assert_eq!(order("psnr", "asc", "").unwrap(), "acb");
    assert_eq!(order("method", "", "").unwrap(), "acb");
    assert_eq!(order("method", "desc", "").unwrap(), "cab");
    assert_eq!(order("rank", "", "").unwrap(), "cab");
    assert_eq!(order("scene:apple", "asc", "").unwrap(), "acb");
    // Equal SSIM: the better PSNR first, whichever way.
    assert_eq!(order("ssim", "asc", "").unwrap(), "cab");
    assert_eq!(order("", "", "LOVELACE").unwrap(), "cb");
    assert_eq!(order("", "", "nobody").unwrap(), "b");
    let wrong = order("scene:cube", "", "").unwrap_err();
    assert_eq!((wrong.parameter, wrong.value.as_str()), ("sort", "scene:cube"));
    assert_eq!(order("psnr", "up", "").unwrap_err().parameter, "order");
}

#[test]
fn views_read_their_own_addresses() {
    let board = example();
    let table = board.table(Split::Easy).unwrap();
    for (sort, order) in [("scene:cube", "asc"), ("psnr", "desc"), ("rank", "desc")] {
        let query = ViewQuery {
            split: Some("easy".into()),
            metric: Some("ssim".into()),
            sort: Some(sort.into()),
            order: Some(order.into()),
            q: Some("a&b = \"ü\"".into()),
        };
        let view = View::new(&board, &query).unwrap();
        let address = view.to_query(table);
        assert!(!address.contains(['"', ' ', '<']), "{address}");
        let read: ViewQuery = serde_urlencoded::from_str(address.trim_start_matches('?')).unwrap();
        assert_eq!(View::new(&board, &read).unwrap(), view, "{address}");
    }
}

#[test]
fn places_go_by_the_mean_and_equals_share_the_better_one() {
    let of = |psnr: f64| scores(&[("apple", Split::Easy, &[(psnr, 0.5)])]);
    let mut entries = [("a", 20.0), ("b", 22.0), ("c", 20.0), ("d", 19.0), ("e", 30.0)]
        .map(|(id, psnr)| entry(id, of(psnr)));
    // Baselines do not compete.
    Arc::make_mut(&mut entries[4].about).baseline = true;
    let board = Leaderboard::new("rene", &scenes(&["apple"]), &entries);
    let table = board.table(Split::Easy).unwrap();
    let mut places: Vec<(&str, usize)> =
        table.rows.iter().map(|row| (row.about.id.as_str(), table.place(row, Metric::Psnr))).collect();
    places.sort_unstable();
    assert_eq!(places[..4], [("a", 2), ("b", 1), ("c", 2), ("d", 4)]);
}

#[test]
fn csv_is_quoted_and_runs_no_formula() {
    let mut entry = entry("a", scores(&[("apple", Split::Easy, &[(20.0, 0.5)])]));
    let about = Arc::make_mut(&mut entry.about);
    about.method = "=HYPERLINK(\"http://x\")".into();
    about.authors = "Ada, Bob".into();
    about.evaluator = "relight 0.1.0".into();
    let board = Leaderboard::new("rene", &scenes(&["apple"]), &[entry]);
    let query = ViewQuery { split: Some("easy".into()), ..ViewQuery::default() };
    assert_eq!(
        to_csv(&board, &query).unwrap(),
        "split,id,method,authors,user,baseline,submitted_at,evaluator,images,psnr,psnr_low,psnr_high,psnr_average_rank,ssim,ssim_low,\
         ssim_high,ssim_average_rank,apple_psnr,apple_ssim\r\n\
         easy,a,\"'=HYPERLINK(\"\"http://x\"\")\",\"Ada, Bob\",,false,,relight 0.1.0,2,20.00,20.00,20.00,1.00,0.500,0.500,0.500,1.00,20.00,0.500\r\n"
    );
}

/// Entries with scores of two scenes, so coarse that there are ties.
fn entries() -> impl Strategy<Value = Vec<Entry>> {
    let score = || (0..8i32, 0..4i32).prop_map(|(psnr, ssim)| (f64::from(psnr) * 2.7, f64::from(ssim) * 0.2));
    let scene = || prop::collection::vec(score(), 1..6);
    prop::collection::vec((scene(), scene()), 1..7).prop_map(|all| {
        let entry = |(index, (apple, cube)): (usize, (Vec<_>, Vec<_>))| {
            let rows: Rows<'_> = &[("apple", Split::Easy, &apple), ("cube", Split::Easy, &cube)];
            entry(&format!("{index:02}"), scores(rows))
        };
        all.into_iter().enumerate().map(entry).collect()
    })
}

proptest! {
    #[test]
    fn ranks_add_up_whatever_the_ties(scores in prop::collection::vec(prop::option::of(0..4i32), 0..20)) {
        let scores: Vec<Option<f64>> = scores.into_iter().map(|score| score.map(f64::from)).collect();
        let ranks = ranks(&scores);
        let n = scores.len() as f64;
        prop_assert!((ranks.iter().sum::<f64>() - n * (n + 1.0) / 2.0).abs() < 1e-9);
        for (a, one) in scores.iter().enumerate() {
            for (b, other) in scores.iter().enumerate() {
                let (one, other) = (one.unwrap_or(f64::INFINITY), other.unwrap_or(f64::INFINITY));
                prop_assert_eq!(one > other, ranks[a] < ranks[b]);
            }
        }
    }

    #[test]
    fn average_ranks_add_up_and_intervals_hold_the_mean(entries in entries()) {
        let board = Leaderboard::new("rene", &scenes(&["apple", "cube"]), &entries);
        let table = board.table(Split::Easy).unwrap();
        let n = table.rows.len() as f64;
        for metric in Metric::ALL {
            let sum: f64 = table.rows.iter().map(|row| row.standing(metric).rank).sum();
            prop_assert!((sum - n * (n + 1.0) / 2.0).abs() < 1e-9);
            for row in &table.rows {
                let standing = row.standing(metric);
                let (mean, (low, high)) = (standing.mean.unwrap(), standing.interval.unwrap());
                prop_assert!(low <= mean && mean <= high, "{low} {mean} {high}");
            }
        }
    }

    #[test]
    fn the_order_of_entries_and_images_does_not_matter(entries in entries(), seed in any::<u64>()) {
        let scenes = scenes(&["apple", "cube"]);
        let board = Leaderboard::new("rene", &scenes, &entries);
        let random = relight_field::random::Random::new(seed, 0);
        let shuffled = |count: usize, stream: u64| -> Vec<usize> {
            let mut order: Vec<usize> = (0..count).collect();
            order.sort_by_key(|&index| random.u64_at(stream * 1000 + index as u64));
            order
        };
        let mut others = Vec::new();
        for index in shuffled(entries.len(), 1) {
            let mut entry = entries[index].clone();
            let mut scores = (*entry.scores).clone();
            let order = shuffled(scores.images.len(), 2);
            scores.images = order.into_iter().map(|image| scores.images[image].clone()).collect();
            entry.intervals = Intervals::of(&scores);
            entry.scores = Arc::new(scores);
            others.push(entry);
        }
        let other = Leaderboard::new("rene", &scenes, &others);
        for (one, other) in board.tables.iter().zip(&other.tables) {
            for (one, other) in one.rows.iter().zip(&other.rows) {
                prop_assert_eq!(&one.about, &other.about);
                for metric in Metric::ALL {
                    let (a, b) = (one.standing(metric), other.standing(metric));
                    prop_assert_eq!((a.mean, &a.scenes, a.rank), (b.mean, &b.scenes, b.rank));
                    // A mean that is summed in another order may fall to the other side of a half of the last digit.
                    let (low, high) = (a.interval.unwrap(), b.interval.unwrap());
                    prop_assert!((low.0 - high.0).abs() < 0.011 && (low.1 - high.1).abs() < 0.011);
                }
            }
        }
    }
}
