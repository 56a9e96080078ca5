! Pairwise constraints: look-up tables of the model pairs that each data pair may be (thesis 5.7, appendix C)
ENTRY SUBROUTINE TABLES(NEAREST, FARTHEST, ANGLE, LOW, HIGH, ALOW, AHIGH, N, MATCH, MATCHSUM)
  IMPLICIT NONE
! NEAREST, FARTHEST, ANGLE: of every pair of model edges; LOW..AHIGH: the data pairs' distances and angles
  REAL NEAREST(,), FARTHEST(,), ANGLE(,)
  INTEGER N, MATCHSUM(N), I
  REAL LOW(N), HIGH(N), ALOW(N), AHIGH(N)
  LOGICAL MATCH(,,N)
  DO 10 I = 1, N
    MATCH(,,I) = NEAREST .LE. LOW(I) .AND. FARTHEST .GE. HIGH(I)
    MATCH(,,I) = MATCH(,,I) .AND. ANGLE .GE. ALOW(I) .AND. ANGLE .LE. AHIGH(I)
10 CONTINUE
  DO 20 I = 1, N
    MATCHSUM(I) = SUM(MATCH(,,I))
20 CONTINUE
END
