! Laplacian of a Gaussian: edges as zero crossings of the smoothed image's Laplacian (thesis 3.7.1)
ENTRY SUBROUTINE LOG_EDGES(IMAGE, RESULT, SIGMA, CONTRAST)
  IMPLICIT NONE
  INTEGER*2 IMAGE(,)
  LOGICAL RESULT(,)
  REAL SIGMA, CONTRAST
  REAL S(*SIZE(IMAGE, 1), *SIZE(IMAGE, 2)), L(*SIZE(IMAGE, 1), *SIZE(IMAGE, 2))
  IF (SIGMA .LE. 0.0) SIGMA = 1.0
  IF (CONTRAST .LE. 0.0) CONTRAST = 1.0
  S = FLOAT(IMAGE)
  CALL SMOOTH(S, SIGMA)
  L = S(+,) + S(-,) + S(,+) + S(,-) - 4.0*S
! a crossing lies between two neighbours of opposite sign that differ enough
  RESULT = L*L(,+) .LT. 0.0 .AND. ABS(L - L(,+)) .GT. CONTRAST
  RESULT = RESULT .OR. (L*L(+,) .LT. 0.0 .AND. ABS(L - L(+,)) .GT. CONTRAST)
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
