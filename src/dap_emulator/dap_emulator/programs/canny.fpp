! Canny: smoothing, gradient, thinning along the gradient, and linking by hysteresis (thesis 3.7.2)
ENTRY SUBROUTINE CANNY(IMAGE, RESULT, SIGMA, LOW, HIGH)
  IMPLICIT NONE
  INTEGER*2 IMAGE(,)
  LOGICAL RESULT(,)
  REAL SIGMA, LOW, HIGH
  REAL S(*SIZE(IMAGE, 1), *SIZE(IMAGE, 2)), M(*SIZE(IMAGE, 1), *SIZE(IMAGE, 2))
  REAL GX(*SIZE(IMAGE, 1), *SIZE(IMAGE, 2)), GY(*SIZE(IMAGE, 1), *SIZE(IMAGE, 2))
  LOGICAL PEAK(*SIZE(IMAGE, 1), *SIZE(IMAGE, 2)), WEAK(*SIZE(IMAGE, 1), *SIZE(IMAGE, 2))
  LOGICAL STEEP(*SIZE(IMAGE, 1), *SIZE(IMAGE, 2)), FLAT(*SIZE(IMAGE, 1), *SIZE(IMAGE, 2))
  LOGICAL GROWN(*SIZE(IMAGE, 1), *SIZE(IMAGE, 2))
  IF (SIGMA .LE. 0.0) SIGMA = 1.0
  IF (HIGH .LE. 0.0) HIGH = 20.0
  IF (LOW .LE. 0.0) LOW = 0.4*HIGH
  S = FLOAT(IMAGE)
  CALL SMOOTH(S, SIGMA)
  GX = (S(,+) - S(,-))/2.0
  GY = (S(+,) - S(-,))/2.0
  M = SQRT(GX*GX + GY*GY)
! a peak is no smaller than its two neighbours across the edge: along the rows, the columns or a diagonal
  FLAT = ABS(GY) .LT. 0.4142*ABS(GX)
  STEEP = ABS(GX) .LT. 0.4142*ABS(GY)
  PEAK = M .GE. M(+,-) .AND. M .GT. M(-,+)
  GROWN = GX*GY .GT. 0.0
  WEAK = M .GE. M(+,+) .AND. M .GT. M(-,-)
  PEAK(GROWN) = WEAK
  WEAK = M .GE. M(,+) .AND. M .GT. M(,-)
  PEAK(FLAT) = WEAK
  WEAK = M .GE. M(+,) .AND. M .GT. M(-,)
  PEAK(STEEP) = WEAK
! hysteresis: what is strong, and what is weak and touches it
  WEAK = PEAK .AND. M .GT. LOW
  RESULT = PEAK .AND. M .GT. HIGH
10 CONTINUE
  GROWN = RESULT .OR. RESULT(+,) .OR. RESULT(-,)
  GROWN = WEAK .AND. (GROWN .OR. GROWN(,+) .OR. GROWN(,-))
  IF (.NOT. ANY(GROWN .AND. .NOT. RESULT)) RETURN
  RESULT = RESULT .OR. GROWN
  GOTO 10
END

! Gaussian smoothing in place, down the columns and then along the rows; zeros lie beyond the border
SUBROUTINE SMOOTH(X, SIGMA)
  IMPLICIT NONE
  REAL X(,), SIGMA, WEIGHT, TOTAL
  REAL LOW(*SIZE(X, 1), *SIZE(X, 2)), HIGH(*SIZE(X, 1), *SIZE(X, 2)), SUM2(*SIZE(X, 1), *SIZE(X, 2))
  INTEGER I, RADIUS, AXIS
  RADIUS = FIX(3.0*SIGMA + 0.5)
  TOTAL = 1.0
  DO I = 1, RADIUS
    TOTAL = TOTAL + 2.0*EXP(-FLOAT(I*I)/(2.0*SIGMA*SIGMA))
  END DO
  DO AXIS = 1, 2
    LOW = X
    HIGH = X
    SUM2 = X/TOTAL
    DO I = 1, RADIUS
      IF (AXIS .EQ. 1) THEN
        LOW = LOW(-,)
        HIGH = HIGH(+,)
      ELSE
        LOW = LOW(,-)
        HIGH = HIGH(,+)
      END IF
      WEIGHT = EXP(-FLOAT(I*I)/(2.0*SIGMA*SIGMA))/TOTAL
      SUM2 = SUM2 + WEIGHT*(LOW + HIGH)
    END DO
    X = SUM2
  END DO
END
