! Anti-aliasing: nine samples a pixel weighted 1 2 1 / 2 4 2 / 1 2 1, background and limits (thesis 4.6, appendix A)
ENTRY SUBROUTINE ANTIALIAS(COLOR, DIST, BACKGROUND, SMOOTHED, RESULT)
  IMPLICIT NONE
! COLOR, DIST: brightness and distance of the samples, rows of a pixel first; DIST <= 0 where nothing was hit
  REAL COLOR(,,9), DIST(,,9), BACKGROUND, RESULT(,)
  LOGICAL SMOOTHED
  REAL WEIGHT(9), TOTAL(*SIZE(RESULT, 1), *SIZE(RESULT, 2))
  INTEGER I, ROW, COLUMN
  DATA WEIGHT /1., 2., 1., 2., 4., 2., 1., 2., 1./
  TOTAL = 0.0
  I = 0
  DO 3 ROW = 1, 3
  DO 4 COLUMN = 1, 3
    I = I + 1
    IF (.NOT. SMOOTHED) I = 5
    RESULT = COLOR(,,I)
    RESULT(DIST(,,I) .LE. 0.0) = BACKGROUND
    IF (.NOT. SMOOTHED) GOTO 111
    TOTAL = TOTAL + RESULT*WEIGHT(I)
4 CONTINUE
3 CONTINUE
  RESULT = TOTAL/16.0
111 CONTINUE
  RESULT(RESULT .GT. 255.0) = 255.0
  RESULT(RESULT .LT. 0.0) = 0.0
END
