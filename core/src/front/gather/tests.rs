use super::*;

/// Compares the loop of 32-bit ARM with the loop of other processors: equal energies bit by bit, and equal numbers of runs.
#[test]
fn cut_then_add_equals_cut_and_add_bit_for_bit() {
    const TEXELS: usize = 5;
    let lens = [1, 3, 2, 7, 1, 4, 9, 5];
    let runs = core::array::from_fn::<_, 8, _>(|i| Run::new((3 * i % (TEXELS + 1)) as u32, lens[i]));
    let weights = [9, 700, 65_535, 1, 0, 31, 4_000, 12];
    // The prefix sums of the test overflow 32 bits; their differences do not.
    let mut sums = PrefixSums::new();
    let mut sum = [i32::MAX - 100, i32::MIN, -5, 0];
    for (i, to) in sums.sums.iter_mut().enumerate() {
        sum = core::array::from_fn(|lane| sum[lane].wrapping_add((37 * i + 11 * lane) as i32 % 1009));
        *to = sum;
    }
    // Each chunk ends with a run.
    for (len, count) in [(1, 1), (4, 2), (13, 4), (32, 8)] {
        let (mut quads, mut below) = ([[Quad::default(); TEXELS]; 2], [[0.0; 4]; 2]);
        let mut light: RunLight = [[0.0; 4]; CHUNK];
        let taken = cut(&runs, len, &sums, &mut light);
        add::<4>(&runs, &weights, 1.5, &light[..taken], &mut quads[0], &mut below[0]);
        let at_once = cut_and_add(&runs, &weights, 1.5, sums.of(len), &mut quads[1], &mut below[1]);
        assert_eq!((taken, at_once), (count, count), "{len} places");
        assert_eq!((quads[0], below[0]), (quads[1], below[1]), "{len} places");
        assert!(quads[0].iter().any(|q| q.energy[1] != 0.0), "light");
    }
}

/// The expected marks are those of a loop over the pixels of each run.
#[test]
fn texels_are_marked_by_the_largest_code_of_their_pixels_in_every_layout() {
    let lens = [16, 1, 7, 16, 3, 12, 16, 16, 5, 9, 16, 2, 11, 16, 14, 16, 16];
    let runs = core::array::from_fn::<_, 17, _>(|i| Run::new(i as u32, lens[i]));
    let places: usize = lens.iter().sum();
    let mut state = 1u32;
    // Bright pixels are rare, so that most blocks have none.
    let codes: [u8; 3 * CHUNK] = core::array::from_fn(|_| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        if state >> 26 == 0 { (state >> 16) as u8 } else { (state >> 25) as u8 }
    });
    let words = codes.map(u16::from);
    let planes: [[u8; CHUNK]; 3] = core::array::from_fn(|lane| core::array::from_fn(|i| codes[3 * i + lane]));
    let layouts =
        [Codes::Bytes(&codes), Codes::Words(&words), Codes::Planes([0, 1, 2].map(|i| &planes[i][..]))];
    let limits = [(150, 250), (u32::MAX, 200), (140, u32::MAX), (0, 255)];
    for (bright, clipped) in limits {
        for (layout, len) in layouts.iter().flat_map(|layout| [(layout, CHUNK), (layout, 101)]) {
            let mut quads = [Quad::default(); 17];
            let limits = Limits { bright, clipped, saturated: 255 };
            Runs { runs: &runs, weights: &[1; 17] }.mark(layout, 3, len, limits, &mut quads);
            let mut first = 0;
            for (quad, run) in quads.iter().zip(lens) {
                let pixels = first.min(len)..(first + run).min(len);
                let most = codes[3 * pixels.start..3 * pixels.end].iter().max().map(|code| u32::from(*code));
                let reaches = |limit| most.is_some_and(|most| most >= limit);
                let expected = Mark { bright: reaches(bright), clipped: reaches(clipped) };
                assert_eq!(Mark::of(quad), expected, "{layout:?}: run from {first}, {len} pixels");
                first += run;
            }
        }
    }
    assert!(places >= CHUNK, "{places}");
}
