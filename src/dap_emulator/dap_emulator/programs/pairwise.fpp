! Pairwise constraints: ranges, and the model pairs that each data pair may be, with signs (thesis 5.5, 5.7, 6.6)
ENTRY SUBROUTINE PAIRWISE(MODEL, MKIND, DATUM, DKIND, TOLERANCE, USE, SIGNED, DATUM1, DATUM2, PAIRS, ITEMS, &
    EDGES, MATCH, SIGNS, MATCHSUM)
  IMPLICIT NONE
! MODEL, DATUM: of each feature its middle, unit direction, half length (0 of a curve) and two radii; metres
! MKIND, DKIND: 0 an edge, 1 a planar curve, 2 an axis; -1 in the model stands for the bin
! TOLERANCE: of each data feature the errors across and along, metres, and the half angle of its cone, radians
! USE: which of distance, angle, direction 1, 2 and 3 are tested; SIGNED: whether signs must be consistent
! MATCH(i, j, pair): the pair's first feature may be on i while its second is on j
! SIGNS(i, j, k, pair): their signs may be 1 the same, 2 opposite; the first + (3) or - (4), the second + (5) or - (6)
! EDGES: the number of model features
  INTEGER PAIRS, ITEMS, EDGES, MKIND(), DKIND(), DATUM1(PAIRS), DATUM2(PAIRS), MATCHSUM(PAIRS)
  REAL*8 MODEL(,9), DATUM(,9), TOLERANCE(,3)
  LOGICAL USE(5), SIGNED, MATCH(*EDGES,*EDGES,PAIRS), SIGNS(*EDGES,*EDGES,6,PAIRS)
  REAL*8 LOW(*EDGES,*EDGES,5), HIGH(*EDGES,*EDGES,5), LENGTHS(*EDGES,*EDGES), NONE(*EDGES)
  REAL*8 DLOW(*ITEMS,*ITEMS,5), DHIGH(*ITEMS,*ITEMS,5), ERROR(*ITEMS), SLACK, L, H, PI, ROUNDING
  LOGICAL ONE(*EDGES,*EDGES), BIN(*EDGES), MAYBE(*EDGES, ITEMS), M(*EDGES,*EDGES), S(*EDGES,*EDGES,6)
  LOGICAL SKEW(*EDGES,*EDGES), DSKEW(*ITEMS,*ITEMS)
  INTEGER I, K, A, B
  PARAMETER (PI = 3.14159265358979D0, ROUNDING = 1.0D-9)
  NONE = 0.0D0
  CALL RANGES(MODEL, NONE, NONE, LOW, HIGH, SKEW)
  CALL RANGES(DATUM, TOLERANCE(,1), TOLERANCE(,3), DLOW, DHIGH, DSKEW)
  ERROR = SQRT(TOLERANCE(,1)*TOLERANCE(,1) + TOLERANCE(,2)*TOLERANCE(,2))
  LENGTHS = MATC(2.0D0*MODEL(,7))
  ONE = PATUNITDIAG(EDGES, EDGES)
  BIN = MKIND .EQ. -1
! what a feature may be on by itself: its own type, and no shorter than it is
  DO 10 K = 1, ITEMS
    MAYBE(,K) = MKIND .EQ. DKIND(K)
    L = 0.0D0
    IF (DKIND(K) .NE. 1) L = 2.0D0*DATUM(K,7) - 2.0D0*TOLERANCE(K,2)
    IF (USE(1)) MAYBE(,K) = MAYBE(,K) .AND. 2.0D0*MODEL(,7) .GE. L - ROUNDING
    MAYBE(,K) = MAYBE(,K) .OR. BIN
10 CONTINUE
  DO 100 I = 1, PAIRS
    A = DATUM1(I)
    B = DATUM2(I)
    SLACK = ERROR(A) + ERROR(B)
    M = .TRUE.
    S = .TRUE.
    IF (.NOT. USE(1)) GOTO 20
    L = DLOW(A,B,1)
    H = DHIGH(A,B,1)
    M = LOW(,,1) .LE. L + ROUNDING .AND. HIGH(,,1) .GE. H - ROUNDING
!   two pieces of one edge reach no farther than it is long
    M(ONE) = LENGTHS .GE. H - SLACK
20  CONTINUE
    IF (.NOT. USE(2)) GOTO 30
    L = DLOW(A,B,2)
    H = DHIGH(A,B,2)
    S(,,1) = LOW(,,2) .GE. H - ROUNDING .AND. LOW(,,2) .LE. L + ROUNDING
    S(,,2) = LOW(,,2) .GE. PI - L - ROUNDING .AND. LOW(,,2) .LE. PI - H + ROUNDING
30  CONTINUE
    DO 40 K = 1, 2
      IF (.NOT. USE(K + 2)) GOTO 40
      L = DLOW(A,B,K + 2)
      H = DHIGH(A,B,K + 2)
!     two pieces of one edge that are clear of each other lie on one line
      IF (DLOW(A,B,1) .GT. 2.0D0*SLACK .AND. L .LT. PI .AND. H .GT. 0.0D0) M = M .AND. .NOT. ONE
      CALL INSIDE(LOW(,,K + 2), HIGH(,,K + 2), L, H, ONE, S(,,2*K + 1))
      CALL INSIDE(LOW(,,K + 2), HIGH(,,K + 2), PI - H, PI - L, ONE, S(,,2*K + 2))
40  CONTINUE
    IF (.NOT. USE(5)) GOTO 50
!   lines without a common normal can only be such lines
    IF (.NOT. DSKEW(A,B)) M = M .AND. (ONE .OR. .NOT. SKEW)
    IF (.NOT. DSKEW(A,B)) GOTO 50
    M = M .AND. (ONE .OR. SKEW)
    L = DLOW(A,B,5)
    H = DHIGH(A,B,5)
    CALL INSIDE(LOW(,,5), HIGH(,,5), L, H, ONE, S(,,1))
    CALL INSIDE(LOW(,,5), HIGH(,,5), PI - H, PI - L, ONE, S(,,2))
50  CONTINUE
    M = M .AND. (S(,,1) .OR. S(,,2)) .AND. (S(,,3) .OR. S(,,4)) .AND. (S(,,5) .OR. S(,,6))
    IF (SIGNED) M = M .AND. ((S(,,1) .AND. ((S(,,3) .AND. S(,,5)) .OR. (S(,,4) .AND. S(,,6)))) &
      .OR. (S(,,2) .AND. ((S(,,3) .AND. S(,,6)) .OR. (S(,,4) .AND. S(,,5)))))
    M = M .AND. MATC(MAYBE(,A)) .AND. MATR(MAYBE(,B)) .AND. .NOT. (MATC(BIN) .OR. MATR(BIN))
    MATCHSUM(I) = SUM(M)
    DO 60 K = 1, 6
      SIGNS(,,K,I) = S(,,K) .AND. M
60  CONTINUE
!   in the bin a feature agrees with whatever the other may be by itself
    MATCH(,,I) = M .OR. ((MATC(BIN) .OR. MATR(BIN)) .AND. MATC(MAYBE(,A)) .AND. MATR(MAYBE(,B)))
100 CONTINUE
END

! Keep what lies within the model's ranges, and what is on one edge
SUBROUTINE INSIDE(LOW, HIGH, L, H, ONE, KEPT)
  IMPLICIT NONE
  REAL*8 LOW(,), HIGH(,), L, H
  LOGICAL ONE(,), KEPT(,)
  KEPT = KEPT .AND. (ONE .OR. (LOW .LE. L + 1.0D-9 .AND. HIGH .GE. H - 1.0D-9))
END

! Ranges of all pairs, the first feature along the columns' direction: 1 distance, 2 angle, 3 to 5 the directions.
! They are those of the four vectors between ends; data are drawn in by their errors, so LOW may exceed HIGH.
! SKEW: whether the lines have a common normal, as far as their cones tell
SUBROUTINE RANGES(F, ERROR, CONE, LOW, HIGH, SKEW)
  IMPLICIT NONE
  REAL*8 F(,9), ERROR(), CONE(), LOW(,,5), HIGH(,,5)
  LOGICAL SKEW(,)
  REAL*8 A(*SIZE(ERROR), *SIZE(ERROR), 3), B(*SIZE(ERROR), *SIZE(ERROR), 3), N(*SIZE(ERROR), *SIZE(ERROR), 3)
  REAL*8 GAP(*SIZE(ERROR), *SIZE(ERROR), 3), R(*SIZE(ERROR), *SIZE(ERROR), 3)
  REAL*8 HALF(*SIZE(ERROR)), HA(*SIZE(ERROR), *SIZE(ERROR)), HB(*SIZE(ERROR), *SIZE(ERROR))
  REAL*8 SINE(*SIZE(ERROR), *SIZE(ERROR)), FAR(*SIZE(ERROR), *SIZE(ERROR)), OVER(*SIZE(ERROR), *SIZE(ERROR))
  REAL*8 T(*SIZE(ERROR), *SIZE(ERROR))
  INTEGER I, K
  HALF = MAX(F(,7) - ERROR, 0.0D0)
  HA = MATC(HALF)
  HB = MATR(HALF)
  DO 10 K = 1, 3
    A(,,K) = MATC(F(,K + 3))
    B(,,K) = MATR(F(,K + 3))
    GAP(,,K) = MATR(F(,K)) - MATC(F(,K))
10 CONTINUE
  N(,,1) = A(,,2)*B(,,3) - A(,,3)*B(,,2)
  N(,,2) = A(,,3)*B(,,1) - A(,,1)*B(,,3)
  N(,,3) = A(,,1)*B(,,2) - A(,,2)*B(,,1)
  SINE = SQRT(N(,,1)*N(,,1) + N(,,2)*N(,,2) + N(,,3)*N(,,3))
  T = A(,,1)*B(,,1) + A(,,2)*B(,,2) + A(,,3)*B(,,3)
  LOW = 1.0D30
  HIGH = -1.0D30
  LOW(,,2) = ATAN2(SINE, T)
  HIGH(,,2) = LOW(,,2)
  SKEW = SINE .GT. MAX(SIN(MIN(MATC(CONE) + MATR(CONE), 1.5707963267949D0)), 1.0D-6)
  OVER = 0.0D0
  OVER(SKEW) = 1.0D0/SINE
  DO 20 K = 1, 3
    N(,,K) = N(,,K)*OVER
20 CONTINUE
  DO 50 I = 1, 4
    IF (I .NE. 1) HB = -HB
    IF (I .EQ. 3) HA = -HA
    DO 30 K = 1, 3
      R(,,K) = GAP(,,K) + HB*B(,,K) - HA*A(,,K)
30  CONTINUE
    FAR = SQRT(R(,,1)*R(,,1) + R(,,2)*R(,,2) + R(,,3)*R(,,3))
    LOW(,,1) = MIN(LOW(,,1), FAR)
    HIGH(,,1) = MAX(HIGH(,,1), FAR)
    OVER = 0.0D0
    OVER(FAR .GT. 1.0D-9) = 1.0D0/FAR
    DO 40 K = 3, 5
      IF (K .EQ. 3) T = R(,,1)*A(,,1) + R(,,2)*A(,,2) + R(,,3)*A(,,3)
      IF (K .EQ. 4) T = R(,,1)*B(,,1) + R(,,2)*B(,,2) + R(,,3)*B(,,3)
      IF (K .EQ. 5) T = R(,,1)*N(,,1) + R(,,2)*N(,,2) + R(,,3)*N(,,3)
      T = ACOS(MIN(MAX(T*OVER, -1.0D0), 1.0D0))
      LOW(,,K) = MIN(LOW(,,K), T)
      HIGH(,,K) = MAX(HIGH(,,K), T)
40  CONTINUE
50 CONTINUE
  LOW(,,1) = LOW(,,1) + MATC(ERROR) + MATR(ERROR)
  HIGH(,,1) = HIGH(,,1) - MATC(ERROR) - MATR(ERROR)
  DO 60 K = 2, 5
    T = 0.0D0
    IF (K .NE. 4) T = T + MATC(CONE)
    IF (K .NE. 3) T = T + MATR(CONE)
    LOW(,,K) = LOW(,,K) + T
    HIGH(,,K) = HIGH(,,K) - T
60 CONTINUE
END
