//! Checks that the board in the pictures has the stated size: of a larger one every picture would show a part only.

use super::BoardView;
use super::detect::Chessboard;
use super::outcome::BoardError;

/// This many pictures with a larger board are ignored: they show a pattern of something else.
const FEW: usize = 1;

/// Refuses a chessboard of another size than `board`. `views` are all pictures that show it, `larger` the sizes from
/// [`super::DetectError::OtherBoard`] of pictures with more corners.
///
/// The board is larger than stated if the pictures of a larger one outnumber those of the whole stated board and a third of
/// all. It is smaller if no picture shows it whole and half of them end at the same corners: parts of a board that is never
/// seen whole end at different corners.
///
/// # Errors
/// [`BoardError::OtherSize`] with the largest size that was found.
pub fn check_size(
    board: &Chessboard,
    views: &[BoardView],
    larger: &[[u32; 2]],
) -> Result<(), BoardError> {
    let expected = sorted(board.corners);
    let extents: Vec<[u32; 2]> = views
        .iter()
        .map(|view| sorted(extent(view, board.square_m)))
        .collect();
    let showing = |size: [u32; 2]| extents.iter().filter(|it| **it == size).count();
    let most_larger = larger.len() > showing(expected) && 2 * larger.len() > views.len();
    if larger.len() > FEW && most_larger {
        return Err(BoardError::OtherSize {
            found: most(larger.iter().map(|it| sorted(*it))),
            pictures: larger.len(),
            expected,
        });
    }
    let found = most(extents.iter().copied());
    let pictures = showing(found);
    if views.is_empty() || found == expected || 2 * pictures < views.len() {
        return Ok(());
    }
    Err(BoardError::OtherSize {
        found,
        pictures,
        expected,
    })
}

/// The largest shorter and longer side.
fn most(sizes: impl Iterator<Item = [u32; 2]>) -> [u32; 2] {
    sizes.fold([0, 0], |[a, b], [c, d]| [a.max(c), b.max(d)])
}

/// The shorter side first.
fn sorted([a, b]: [u32; 2]) -> [u32; 2] {
    [a.min(b), a.max(b)]
}

/// Corners along both sides of the visible part.
fn extent(view: &BoardView, square_m: f64) -> [u32; 2] {
    [0, 1].map(|axis| {
        let along = || view.board_m.iter().map(|at| at[axis]);
        let span_m =
            along().fold(f64::NEG_INFINITY, f64::max) - along().fold(f64::INFINITY, f64::min);
        // A float is converted to the nearest value of the integer type.
        (span_m / square_m).round().max(0.0) as u32 + 1
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::board::Print;

    fn view([across, down]: [u32; 2]) -> BoardView {
        let corners = (0..across).flat_map(|x| (0..down).map(move |y| [x, y]));
        let board_m: Vec<[f64; 2]> = corners.map(|it| it.map(|i| 0.06 * f64::from(i))).collect();
        BoardView {
            name: String::new(),
            pixels: board_m.clone(),
            board_m,
            print: Print::default(),
        }
    }

    fn check(corners: [u32; 2], seen: &[[u32; 2]], larger: &[[u32; 2]]) -> Result<(), String> {
        let board = Chessboard {
            corners,
            square_m: 0.06,
        };
        let views: Vec<BoardView> = seen.iter().map(|it| view(*it)).collect();
        check_size(&board, &views, larger).map_err(|it| it.to_string())
    }

    #[test]
    fn one_picture_of_the_whole_board_is_enough_in_any_orientation() {
        assert_eq!(check([4, 7], &[[7, 4]], &[]), Ok(()));
        assert_eq!(
            check([7, 4], &[[3, 3], [4, 2], [3, 7], [7, 4]], &[]),
            Ok(())
        );
        assert_eq!(check([4, 7], &[], &[]), Ok(()));
    }

    #[test]
    fn other_patterns_in_a_few_pictures_are_ignored() {
        assert_eq!(check([4, 7], &[[4, 7], [4, 6]], &[[9, 12]]), Ok(()));
        // A tiled floor, in two pictures of a video that shows the whole board in a hundred.
        let many = [[4, 7]; 100];
        assert_eq!(check([4, 7], &many, &[[9, 12], [5, 7]]), Ok(()));
        let parts = [[4, 5], [3, 7], [4, 6], [2, 7], [4, 4], [3, 3]];
        assert_eq!(check([5, 9], &parts, &[[9, 12], [6, 9]]), Ok(()));
    }

    #[test]
    fn a_board_that_is_only_seen_in_part_is_accepted() {
        let parts = [[7, 6], [5, 9], [8, 6], [4, 7], [6, 6], [7, 9]];
        assert_eq!(check([8, 11], &parts, &[]), Ok(()));
    }

    #[test]
    fn a_board_stated_too_large_or_too_small_is_refused() {
        let message = check([5, 9], &[[7, 4], [4, 7], [4, 6]], &[]).unwrap_err();
        assert!(
            message.contains("4 x 7") && message.contains("5 x 9"),
            "{message}"
        );
        for wrong in [[4, 8], [5, 7], [8, 4]] {
            assert!(check(wrong, &[[4, 7], [7, 4]], &[]).is_err(), "{wrong:?}");
        }
        let message = check([3, 6], &[[3, 6]], &[[7, 4], [4, 7]]).unwrap_err();
        assert!(
            message.contains("4 x 7") && message.contains("3 x 6"),
            "{message}"
        );
    }
}
