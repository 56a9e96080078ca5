! Sobel: gradient magnitude and direction over a 3 x 3 window (thesis 3.7.1)
ENTRY SUBROUTINE SOBEL(IMAGE, RESULT, ANGLE)
  IMPLICIT NONE
  INTEGER*2 IMAGE(,)
  REAL RESULT(,), ANGLE(,)
  INTEGER*2 LINE(*SIZE(IMAGE, 1), *SIZE(IMAGE, 2))
  REAL GX(*SIZE(IMAGE, 1), *SIZE(IMAGE, 2)), GY(*SIZE(IMAGE, 1), *SIZE(IMAGE, 2))
! smooth down the columns, difference along the rows; then the other way round
  LINE = IMAGE(-,) + 2*IMAGE + IMAGE(+,)
  GX = FLOAT(LINE(,+) - LINE(,-))
  LINE = IMAGE(,-) + 2*IMAGE + IMAGE(,+)
  GY = FLOAT(LINE(+,) - LINE(-,))
  RESULT = SQRT(GX*GX + GY*GY)
  ANGLE = ATAN2(GY, GX)
END
