//! Font of 3 x 5 dots for the labels of pictures: capital letters, digits and a few signs.

use image::{Rgb, RgbImage};

/// Characters and glyphs of five rows of three dots, top row first; a row is an octal digit, in which 4 is the left dot.
const GLYPHS: [(char, u16); 42] = [
    ('A', 0o25755),
    ('B', 0o65656),
    ('C', 0o34443),
    ('D', 0o65556),
    ('E', 0o74647),
    ('F', 0o74644),
    ('G', 0o34553),
    ('H', 0o55755),
    ('I', 0o72227),
    ('J', 0o11152),
    ('K', 0o55655),
    ('L', 0o44447),
    ('M', 0o57755),
    ('N', 0o65555),
    ('O', 0o25552),
    ('P', 0o65644),
    ('Q', 0o25573),
    ('R', 0o65655),
    ('S', 0o34216),
    ('T', 0o72222),
    ('U', 0o55557),
    ('V', 0o55552),
    ('W', 0o55775),
    ('X', 0o55255),
    ('Y', 0o55222),
    ('Z', 0o71247),
    ('0', 0o75557),
    ('1', 0o26227),
    ('2', 0o71747),
    ('3', 0o71717),
    ('4', 0o55711),
    ('5', 0o74717),
    ('6', 0o74757),
    ('7', 0o71122),
    ('8', 0o75757),
    ('9', 0o75717),
    ('.', 0o00002),
    ('%', 0o51245),
    ('-', 0o00700),
    ('+', 0o02720),
    (':', 0o02020),
    (',', 0o00024),
];

/// Draws `text` with its upper left corner at (x, y) and dots of `scale` pixels; characters that the font lacks become gaps.
pub fn write(picture: &mut RgbImage, text: &str, [x, y]: [u32; 2], scale: u32, colour: [u8; 3]) {
    for (k, letter) in text.chars().enumerate() {
        let Some((_, glyph)) = GLYPHS.iter().find(|(c, _)| *c == letter) else { continue };
        for dot in (0..15).filter(|dot| glyph >> (14 - dot) & 1 == 1) {
            let (left, top) = (x + (4 * k as u32 + dot % 3) * scale, y + dot / 3 * scale);
            for (dx, dy) in (0..scale * scale).map(|i| (i % scale, i / scale)) {
                if left + dx < picture.width() && top + dy < picture.height() {
                    picture.put_pixel(left + dx, top + dy, Rgb(colour));
                }
            }
        }
    }
}
