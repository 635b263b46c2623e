//! Whether the board in the pictures is as large as was said: one that is said to be larger is found in part in every picture.

use super::BoardView;
use super::detect::Chessboard;
use super::found::BoardError;

/// Pictures with a larger board that are too many to be a pattern of something else.
const FEW: usize = 2;

/// Refuses a chessboard of another size than `board`: one that is nowhere seen from end to end, and one that is larger in two
/// pictures or more. `larger` is what [`super::DetectError::OtherBoard`] said of pictures that show more corners.
///
/// # Errors
/// [`BoardError::OtherSize`] with the most that was found.
pub fn check_size(
    board: &Chessboard,
    views: &[BoardView],
    larger: &[[u32; 2]],
) -> Result<(), BoardError> {
    let expected = sorted(board.corners);
    if larger.len() >= FEW {
        let most = |side: usize| larger.iter().map(|it| sorted(*it)[side]).max();
        return Err(BoardError::OtherSize {
            found: [0, 1].map(|side| most(side).unwrap_or(0)),
            pictures: larger.len(),
            expected,
        });
    }
    let extents: Vec<[u32; 2]> = views
        .iter()
        .map(|view| sorted(extent(view, board.square_m)))
        .collect();
    let most = [0, 1].map(|side| extents.iter().map(|it| it[side]).max().unwrap_or(0));
    if views.is_empty() || most == expected {
        return Ok(());
    }
    Err(BoardError::OtherSize {
        found: most,
        pictures: extents.iter().filter(|it| **it == most).count(),
        expected,
    })
}

/// The shorter side first.
fn sorted([a, b]: [u32; 2]) -> [u32; 2] {
    [a.min(b), a.max(b)]
}

/// Corners along both sides of what was seen.
fn extent(view: &BoardView, square_m: f64) -> [u32; 2] {
    [0, 1].map(|axis| {
        let along = || view.board_m.iter().map(|at| at[axis]);
        let span_m =
            along().fold(f64::NEG_INFINITY, f64::max) - along().fold(f64::INFINITY, f64::min);
        // A float becomes the nearest whole number that there is.
        (span_m / square_m).round().max(0.0) as u32 + 1
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn view([across, down]: [u32; 2]) -> BoardView {
        let corners = (0..across).flat_map(|x| (0..down).map(move |y| [x, y]));
        let board_m: Vec<[f64; 2]> = corners.map(|it| it.map(|i| 0.06 * f64::from(i))).collect();
        BoardView {
            name: String::new(),
            pixels: board_m.clone(),
            board_m,
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
    fn one_picture_from_end_to_end_is_enough_whichever_way_it_is_turned() {
        assert_eq!(check([4, 7], &[[7, 4]], &[]), Ok(()));
        assert_eq!(
            check([7, 4], &[[3, 3], [4, 2], [3, 7], [7, 4]], &[]),
            Ok(())
        );
        // A pattern of something else in one picture.
        assert_eq!(check([4, 7], &[[4, 7], [4, 6]], &[[9, 12]]), Ok(()));
        assert_eq!(check([4, 7], &[], &[]), Ok(()));
    }

    #[test]
    fn a_board_that_is_said_to_be_larger_or_smaller_is_refused() {
        let said = check([5, 9], &[[7, 4], [4, 7], [4, 6]], &[]).unwrap_err();
        assert!(said.contains("4 x 7") && said.contains("5 x 9"), "{said}");
        for wrong in [[4, 8], [5, 7], [8, 4]] {
            assert!(check(wrong, &[[4, 7], [7, 4]], &[]).is_err(), "{wrong:?}");
        }
        let said = check([3, 6], &[[3, 6]], &[[7, 4], [4, 7]]).unwrap_err();
        assert!(said.contains("4 x 7") && said.contains("3 x 6"), "{said}");
    }
}
